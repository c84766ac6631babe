"""Experiments with teams of real and virtual robots, independent of drivers and commands.

`team` runs one without a bus, faster than real time, and measures it. `scenario` reads one from a file; its `plan` is
plain data. `live` runs a scenario's processes on the bus, `sweep` many runs without it, and `fidelity` compares teams
with one real robot to all-real ones.
"""
