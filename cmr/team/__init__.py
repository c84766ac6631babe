"""Experiments with teams of real and virtual robots, without hardware, without a bus, and as fast as they go.

`hidden` draws the robots that nobody knows, `plant` moves them, `real_robot` gives them driver, sensors and pilot,
`experiment` lets a team run, `metrics` scores it, `population` draws virtual robots that differ as real ones do.
"""
