"""Interaction of robots: neighbours, obstacles, contacts, and range sensors.

Everything works on arrays and is independent of the bus, the world and behaviours. Lengths are in m, angles in rad,
positions in the world frame.
"""
