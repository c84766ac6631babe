"""The model as an observer of recorded drives: prediction errors for many candidates at once.

`observer` prepares the arguments of the compiled `loops`, which are `structures`; `drives` joins recorded drives. The
functions of the loops are in `helpers`, `commanding`, `reading` and `corrections`; `sensing` composes the effects of
sensors, which the loops call.
"""
