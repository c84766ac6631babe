"""The parameter file of a robot: read, write atomically, announce, and track its changes."""
