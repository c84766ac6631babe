"""Experiments with teams of real and virtual robots, without hardware, without a bus, and as fast as they go.

`hidden` draws the robots that nobody knows, `plant` moves them, `real_robots` gives them driver, sensors and pilot,
`experiment` lets a team run, `scoring` tells by the `metrics` how it did, `population` draws virtual robots that differ
as real ones do.
"""
