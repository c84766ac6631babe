"""A node that plays the bag of a robot's drive at its own pace, with the stamps that the messages have in it.

python -m tests.support.ros2_player FOLDER --domain-id 42
"""

import sys
import time
from pathlib import Path

from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from robot_driver.ros2.network import choose_network
from robot_driver.ros2.node import Node

PATIENCE = 60.0  # s for somebody to listen


def main(arguments: list[str]) -> None:
    """Play the bag to its end."""
    folder, _, domain = arguments
    choose_network(int(domain), "localhost")
    with Node("player", lambda: None) as node, AnyReader([Path(folder)], default_typestore=STORE) as bag:
        publishers = {one.topic: node.publisher(one.topic, one.msgtype) for one in bag.connections}
        until = time.monotonic() + PATIENCE
        heard = [publisher for topic, publisher in publishers.items() if topic != "/cmd_vel"]
        while time.monotonic() < until and not all(publisher.heard_by for publisher in heard):
            time.sleep(0.05)
        begin = time.monotonic()
        for connection, received, data in bag.messages():
            due = begin + (received - bag.start_time) / 1e9
            time.sleep(max(due - time.monotonic(), 0.0))
            publishers[connection.topic].publish(bytes(data))  # as it lies in the bag
        print("played", flush=True)
        time.sleep(1.0)


STORE = get_typestore(Stores.LATEST)

if __name__ == "__main__":
    main(sys.argv[1:])
