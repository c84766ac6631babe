"""The driver and an emulated robot in simulated time: the real code, with all bytes and their timing, without waiting.

`host` is the computer whose clock advances only when every thread waits, `usb` the adapters between it and the robot,
`drive` makes the log of a whole drive.
"""
