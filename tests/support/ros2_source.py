"""A node that publishes numbered joints of some robots, and notes which velocities they are sent, and when.

    python -m tests.support.ros2_source /a,/b RATE COUNT reliable DOMAIN

It says as JSON how many it has published, and the velocities with their arrivals [us], when it has published all, has
waited for what is still on its way, and gets a line on its input.
"""

import json
import sys
import time

from robot_driver.ros2.messages import JOINT_STATE, TWIST, Joints, Ros, read_twist, write_joints
from robot_driver.ros2.network import choose_network
from robot_driver.ros2.node import Node

TICK = 2.0 * 3.141592653589793 / 2048.0  # rad
NAMES = ("wheel_left_joint", "wheel_right_joint")
SETTLING = 1.0  # s


def main(arguments: list[str]) -> None:
    """Publish, and report."""
    names, rate, count, reliability, domain = arguments
    choose_network(int(domain), "localhost")
    heard: list[tuple[float, int]] = []

    def take(message: Ros, arrival: int) -> None:
        heard.append((read_twist(message).v, arrival))

    with Node("source", lambda: None) as node:
        reliable = reliability == "reliable"
        publishers = [
            node.publisher(f"{name}/joint_states", JOINT_STATE, reliable=reliable) for name in names.split(",")
        ]
        for name in names.split(","):
            node.hear(f"{name}/cmd_vel", TWIST, take, reliable=True)
        while not all(publisher.heard_by for publisher in publishers):
            time.sleep(0.05)
        print("ready", flush=True)
        sys.stdin.readline()
        due = time.monotonic()
        for number in range(int(count)):
            for publisher in publishers:
                write_joints(
                    message := publisher.empty(),
                    Joints(time.time_ns() // 1000, NAMES, (number * TICK, number * TICK), (1.0, 1.0)),
                )
                publisher.publish(message)
            due += 1.0 / float(rate)
            time.sleep(max(due - time.monotonic(), 0.0))
            for give, message, arrival in node.arrived():
                give(message, arrival)
        time.sleep(SETTLING)
        for give, message, arrival in node.arrived():
            give(message, arrival)
        print(json.dumps({"published": int(count) * len(publishers), "heard": heard}), flush=True)
        sys.stdin.readline()


if __name__ == "__main__":
    main(sys.argv[1:])
