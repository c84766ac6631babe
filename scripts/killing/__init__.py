"""What scripts/kill does."""
