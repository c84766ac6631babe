"""What scripts/fuzz and scripts/fuzz_bus do."""
