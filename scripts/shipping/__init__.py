"""Builds what is installed on a robot's own computer."""
