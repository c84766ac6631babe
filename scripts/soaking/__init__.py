"""What scripts/soak does: an hour of faults on the real cmr-driver, and the checks on what it did meanwhile."""
