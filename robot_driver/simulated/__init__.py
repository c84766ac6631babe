"""The driver and an emulated robot in simulated time: the code of a drive, its bytes and their timing, without waiting.

`host` is the computer whose clock goes on only when every thread waits, `usb` the adapters between it and the robot,
`drive` makes the log of a whole drive.
"""
