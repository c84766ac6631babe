"""What is wrong in a recording, and what of it can be put right: clocks, poses, wheels, gyro.

`checks` runs all checks, each of which yields `findings`; `joining` makes one recording of several.
"""
