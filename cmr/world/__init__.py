"""The world: all robots, real ones as estimated and virtual ones as simulated, and their behaviours.

`view` is a robot's knowledge of the world, `behaviours` decide from it, `estimator` fuses the sensors of a real robot,
`fleet` simulates virtual robots and twins, `world` combines them, `pilot` drives a real robot.
"""
