"""The world: all robots, real ones as estimated and virtual ones as simulated, and what they decide to do.

`view` is what a robot knows of the world, `behaviours` decide from it, `estimator` fuses the sensors of a real
robot, `fleet` simulates virtual robots and twins, `world` holds them together, `pilot` drives a real robot.
"""
