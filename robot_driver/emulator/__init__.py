"""A stand-in for the real robot: its motors, wheels and sensors, behind serial lines that a driver opens.

It shares no code with the driver or with the model in `cmr`: driver and emulator interact only over the wire.
"""
