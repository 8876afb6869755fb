"""Results of commands as JSON, as tables of pandas and as HTML."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, Any, TypeAlias

import pandas as pd

from terrain_cli.presentation import terminal
from terrain_cli.vocabulary.quantities import short

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from terrain_cli.views.plots import Drawn

Picture: TypeAlias = "tuple[Drawn, str]"  # What is drawn, and the name of its picture
_IN_NAMES = {"N m": "Nm"}  # Of SI units, as they stand in the name of a column
_MOST_ROWS = 50  # Rows that a notebook shows


class Result(ABC):
    """What the results of all commands can do."""

    @property
    @abstractmethod
    def _document(self) -> dict[str, Any]:
        """What the text is made of."""

    @property
    @abstractmethod
    def _picture(self) -> Picture: ...

    def plot(self, name: str = "") -> "Figure":
        """Draw the result.

        Of `simulate` every channel against time, and where the soil changes under a wheel. Of `compare` what
        the (last) model predicts against what was measured. Of `diagnose` what each candidate explains of the
        misfit, and what it does to the held-out loss. Of `add_effect` the held-out error after each change
        that the model remembers, and after this one.

        Parameters
        ----------
        name : str
            Of `compare` also "residual-torque", "track-torque" (both also of "drawbar-pull" and "sinkage"),
            "strength", "rim-stress" or "convergence": a picture of ``terrain-est compare --plot``.

        Returns
        -------
        matplotlib.figure.Figure
            Shown by a notebook; ``savefig`` writes it.

        Raises
        ------
        UsageError
            There is no such picture of these data, or nothing to draw, as no candidate was fitted.
        ConfigurationError
            matplotlib is not installed.
        """
        from terrain_cli.views import plots

        found, usual = self._picture
        return plots.draw(found, name or usual)

    def to_json(self) -> str:
        """Return the text that the command prints with ``--json``, or ``simulate`` writes for ``--truth``.

        Returns
        -------
        str
            JSON, without the newline at the end. Units are SI unless a key, or a unit beside the value, says
            otherwise; null where a value is not known.
        """
        return terminal.as_json(self._document)


def frame(rows: Iterable[Mapping[str, Any]], columns: Sequence[str]) -> pd.DataFrame:
    """Return entries of a document as rows; NaN where it holds null for a number."""
    table = pd.DataFrame(list(rows), columns=list(columns))
    for name in columns:
        if pd.api.types.is_object_dtype(table[name]) and table[name].map(_is_number).all():
            table[name] = table[name].astype(float)
    return table


def _is_number(value: Any) -> bool:
    return value is None or (isinstance(value, int | float) and not isinstance(value, bool))


def column(channel: str, what: str, unit: str) -> str:
    """Return the name of a column, with the unit of its numbers."""
    return f"{channel}_{what}_{_IN_NAMES.get(unit, unit)}"


def html(lines: Iterable[str], tables: Mapping[str, pd.DataFrame]) -> str:
    """Return what a notebook shows: sentences, then tables under their captions."""
    parts = [f"<p>{escape(line)}</p>" for line in lines]
    for caption, table in tables.items():
        if len(table):
            named = table.index.name is not None
            shown = table.to_html(index=named, border=0, float_format=short, na_rep="–", max_rows=_MOST_ROWS)
            parts += [f"<p><b>{escape(caption)}</b></p>", shown]
    return "\n".join(['<div class="terrain-est" style="overflow-x: auto">', *parts, "</div>"])
