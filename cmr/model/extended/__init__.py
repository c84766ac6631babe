"""The model with effects: Python statements of effects are compiled into one step of many robots.

`statements` validates and renames those of each effect. `evaluating` turns them into functions of arrays, `compose`
into the source of a step, split into `loops`. `step_helpers` are functions that statements may call, `stepping` are the
loops around a step; both are compiled once, whatever effects there are. `model` arranges robots in rows and drives
them, `group` does so for a fleet.
"""
