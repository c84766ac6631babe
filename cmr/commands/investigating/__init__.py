"""cmr-investigate: `command` is its command line and the live robot, `emulated` the robot that is none."""
