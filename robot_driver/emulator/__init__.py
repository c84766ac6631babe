"""A stand-in for the real robot: its motors, wheels and sensors, behind serial lines that a driver opens.

Nothing here is shared with the driver or with the model in `cmr`: what the two find out about each other goes
over the wire.
"""
