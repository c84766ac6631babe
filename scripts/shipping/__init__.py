"""Build the packages that are installed on a robot's own computer."""
