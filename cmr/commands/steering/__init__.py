"""Shared by cmr-pilot and cmr-investigate: the process that steers a robot, and its options."""
