"""The model with effects: Python statements of effects become one compiled step of many robots.

`statements` checks those of each effect and names them. `evaluating` makes functions of arrays of them, `compose` the
source of a step, in loops that `loops` cuts. `step_helpers` is what statements may call, `stepping` the loops around a
step; both are compiled once, whatever effects there are. `model` puts robots into rows and drives them, `group` does
so for a fleet.
"""
