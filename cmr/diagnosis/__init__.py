"""Diagnosis: errors of the simulation, their physical causes, the extended model, and its gain on other data."""
