"""Estimate a robot's parameters from recordings: what calibration and diagnosis share.

`checks` refuses what cannot be used, `segments` puts a recording on a time grid, `prediction` compares it with the
model moment by moment, `noise` finds how large the errors are, `gauss_newton` and `problem` fit parameters, `search`
selects the effects that the data show, `averaging` gives estimates that allow for those that the data may hide.
"""
