"""The parameter file of a robot: reading, atomic writing, announcing, and following its changes."""
