"""The colours of real and simulated robots in all drawings."""

REAL_COLOUR = "#f2b705"  # yellow that is visible on white
TWIN_COLOUR = "#1f4fd8"  # blue
