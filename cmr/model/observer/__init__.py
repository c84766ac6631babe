"""The model as an observer of recorded drives: prediction errors for many candidates at once.

`observer` prepares the arguments of the compiled `loops`, which are `structures`; `drives` joins recorded drives. The
functions of the loops are in `helpers`, `commanding`, `ideal_sensors` and `corrections`; the loops call the effects of
sensors, which `sensor_effects` composes.
"""
