"""What a robot may be commanded: each takes one kind."""

DUTY = "duty"  # how hard each side's motor drives
WHEEL_SPEED = "wheel_speed"  # how fast each side's wheels turn, which a controller in the robot sees to
VELOCITY = "velocity"  # how fast the body moves and turns: (v, omega); likewise
KINDS = (DUTY, WHEEL_SPEED, VELOCITY)
