"""Diagnosis: what the simulation gets wrong, the physical cause, the extended model, and the gain on other data."""
