"""Kinds of commands: each robot takes one."""

DUTY = "duty"  # drive of each side's motor
WHEEL_SPEED = "wheel_speed"  # speed of each side's wheels, held by a controller in the robot
VELOCITY = "velocity"  # speed and yaw rate of the body, (v, omega); likewise
KINDS = (DUTY, WHEEL_SPEED, VELOCITY)
