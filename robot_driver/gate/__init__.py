"""The last gate: a small process that owns the motors' port, between the driver and the motor controller.

Only requests that this process permits are written to the motors; when the driver falls silent, is stopped, hangs or
dies, this process stops them. It imports nothing but these files and some of Python's standard library.

`messages` defines the messages between driver and gate, `guard` the permission rules, `wire_*` the controllers'
protocols, `process` the process. Its other end, in the driver, is robot_driver/last_gate.py.
"""
