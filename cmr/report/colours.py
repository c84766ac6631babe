"""In which colours real and simulated robots are drawn, wherever they are."""

REAL_COLOUR = "#f2b705"  # yellow that shows on white
TWIN_COLOUR = "#1f4fd8"  # blue
