"""Experiments with teams of real and virtual robots, without hardware or bus, faster than real time.

`plan` holds a scenario as plain values, `world` makes the world of it, `roles` says which robots are real.
`hidden` draws the true parameters of real robots, `plant` moves them, `real_robots` adds driver, sensors and pilot,
`experiment` runs a team, `scoring` computes `metrics`, `population` draws virtual robots that differ as real ones do.
"""
