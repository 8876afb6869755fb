"""Which physical effect a model lacks: alarm, ranking, families, and what no catalogue knows.

`diagnose` and `steps` are the method in its order. The score and the p value of a candidate are made by
`screening`, its losses by `refits`, families by `refit_ranking`, laws of no known effect by `drafted_laws`,
the answer by `verdict`, and the drive that would settle it by `next_drive`. What every verb says at its end
is a `conclusion` from `evidence`, for which `alarm` scores effects of a model that nobody diagnosed.
"""

from terrain_cli.diagnosis.diagnose import diagnose

__all__ = ["diagnose"]
