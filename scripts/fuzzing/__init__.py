"""Targets, inputs and checks of scripts/fuzz and scripts/fuzz_bus."""
