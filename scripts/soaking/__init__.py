"""The soak test of scripts/soak: an hour of faults for the real cmr-driver, and the checks of what it does."""
