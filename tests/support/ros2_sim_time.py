"""A node with use_sim_time that watches a robot: each odometry, with the time that the node's clock says then.

Prints the clock's time and the odometry's [us], and x [m].

python -m tests.support.ros2_sim_time /robot_10 --domain-id 42
"""

import sys

import rclpy
from rclpy.parameter import Parameter

from robot_driver.ros2.messages import ODOMETRY, Ros, read_odometry
from robot_driver.ros2.network import choose_network
from robot_driver.ros2.node import type_of


def main(arguments: list[str]) -> None:
    """Watch until killed."""
    namespace, _, domain = arguments
    choose_network(int(domain), "localhost")
    rclpy.init()
    node = rclpy.create_node("watcher", parameter_overrides=[Parameter("use_sim_time", value=True)])

    def show(message: Ros) -> None:
        odometry = read_odometry(message)
        print(node.get_clock().now().nanoseconds // 1000, odometry.utime, odometry.x, flush=True)

    node.create_subscription(type_of(ODOMETRY), f"{namespace}/odom", show, 10)
    rclpy.spin(node)


if __name__ == "__main__":
    main(sys.argv[1:])
