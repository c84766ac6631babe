"""A node that drives a robot as a navigation stack would: it hears its odometry, and answers each with a velocity.

It goes by /clock, as nodes with use_sim_time do: odometry of another time is not answered.

python -m tests.support.ros2_navigator /robot_10 --domain-id 42
"""

import sys
import time

from robot_driver.ros2.messages import CLOCK, ODOMETRY, TWIST, Ros, Velocity, read_odometry, read_time, write_twist
from robot_driver.ros2.network import choose_network
from robot_driver.ros2.node import Node

SPEED = 0.2  # m/s


def main(arguments: list[str]) -> None:
    """Drive until killed."""
    namespace, _, domain = arguments
    choose_network(int(domain), "localhost")
    with Node("navigator", lambda: None) as node:
        command = node.publisher(f"{namespace}/cmd_vel", TWIST)

        clock = [0]

        def look(message: Ros, _arrival: int) -> None:
            clock[0] = read_time(message.clock)

        def answer(message: Ros, _arrival: int) -> None:
            odometry = read_odometry(message)
            assert odometry.x == 1.5
            if abs(odometry.utime - clock[0]) > 1_000_000:
                return
            write_twist(twist := command.empty(), Velocity(SPEED, 0.0))
            command.publish(twist)

        node.hear("/clock", CLOCK, look, reliable=True)
        node.hear(f"{namespace}/odom", ODOMETRY, answer, reliable=True)
        while True:
            time.sleep(0.01)
            for take, message, arrival in node.arrived():
                take(message, arrival)


if __name__ == "__main__":
    main(sys.argv[1:])
