"""The last gate: a small process that owns the motors' port, between the driver and the motor controller.

Nothing is written to the motors but what this process lets pass; and when the driver falls silent, is stopped, hangs
or dies, this process stops them. It imports nothing but these files and some of Python's standard library.

`messages` is what the driver sends it and what it reports, `guard` what it lets pass, `wire_*` what it knows of the
controllers, `process` the process. Its other end, in the driver, is robot_driver/last_gate.py.
"""
