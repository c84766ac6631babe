"""Robots that speak ROS 2: real ones on the bus, virtual ones in ROS 2.

Only `node`, `probe` and `command` need rclpy; everything else uses only the fields of messages.
"""
