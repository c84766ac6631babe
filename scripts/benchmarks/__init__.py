"""What scripts/bench measures: each module makes some rows of its table."""
