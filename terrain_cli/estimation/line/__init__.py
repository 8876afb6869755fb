"""Estimators of the line y = c + x tan φ.

`window_estimates` makes the estimate of each window and its status (ok, not-separable, …), with c and φ
of the line in `moments`, or of `ridge`, and standard errors of `uncertainty`, which also bounds what noise
may do to φ; `pooled` follows them sample by sample, and joins windows of one soil.
"""
