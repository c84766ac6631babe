"""Experiments with teams of real and virtual robots; they know no driver and no command.

`team` runs one without a bus, faster than real time, and measures it. `scenario` is one as a file; its `plan` is plain
data. `live` runs a scenario's processes on the bus, `sweep` many of its runs without it, and `fidelity` compares teams
with one real robot to real ones.
"""
