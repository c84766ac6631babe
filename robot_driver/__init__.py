"""Real robots on the bus: `controllers` and `gyros` implement the wire protocols, `driver` owns ports and safety.

`emulator` is the robot on the other end of the line, for labs and tests without hardware.
"""
