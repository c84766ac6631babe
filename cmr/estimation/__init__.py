"""Estimate a robot's parameters from recordings: what calibration and diagnosis share.

`checks` rejects unusable data, `segments` puts a recording on a time grid, `prediction` compares it with one-step
predictions of the model, `noise` estimates the size of the errors, `gauss_newton` and `problem` fit parameters,
`search` selects the effects that the data show, `averaging` gives estimates that allow for undetected effects.
"""
