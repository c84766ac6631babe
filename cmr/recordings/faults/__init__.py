"""Detect and repair faults in a recording: clocks, poses, wheels, gyro.

`checks` runs all checks, which return `findings`; `joining` combines several recordings.
"""
