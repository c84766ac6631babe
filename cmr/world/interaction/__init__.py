"""How robots meet: who is near whom, what stands in the way, who is pushed back, and what a range sensor sees.

Arrays go in and come out; nothing here knows the bus, the world or a behaviour. Lengths are in m, angles in rad,
positions in the world frame.
"""
