"""Estimators of the line y = c + x tan φ.

`window_estimates` makes the estimate of each window and its status (ok, not-separable, …), with c and φ
of `moments`, `ridge` or `recursive` and standard errors of `uncertainty`; `uncertainty` bounds
what noise may do to φ; `pooled` joins windows of one soil.
"""
