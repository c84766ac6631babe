"""cmr-investigate: `command` is its command line and the live robot, `emulated` the emulated robot."""
