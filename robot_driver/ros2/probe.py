"""cmr-ros2 --probe: list the topics, read them for a moment, and write a profile."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from cmr.cli.errors import CommandError
from cmr.files import write_atomically
from robot_driver.ros2.guessing import Found, Topic, guessed
from robot_driver.ros2.messages import JOINT_STATE, Ros
from robot_driver.ros2.node import Node

LOOKING = 15.0  # s at most to find topics, and ...
LISTENING = 3.0  # ... to listen to their joints
SETTLED = 3.0  # s without a new topic, after which the search ends


@dataclass
class _Heard:
    """The messages received on the topic of joints."""

    names: set[str] = field(default_factory=set)
    count: int = 0

    def take(self, message: Ros, _arrival: int) -> None:
        """Store a JointState."""
        self.names |= {str(name) for name in message.name}
        self.count += 1


def probe(path: Path, namespace: str) -> int:
    """Write a profile of the robot whose topics are below `namespace`. Raises CommandError if there are none."""
    if path.exists():
        raise CommandError(f"{path} is there already; it is not written over.")
    with Node("cmr_probe", lambda: None) as node:
        topics = _topics(node.ros, namespace.rstrip("/"))
        joints = {topic.name: _Heard() for topic in topics if topic.kind == JOINT_STATE}
        for name, heard in joints.items():
            node.hear(name, JOINT_STATE, heard.take, reliable=False)
        until = time.monotonic() + LISTENING
        while joints and time.monotonic() < until:
            time.sleep(0.05)
            for take, message, arrival in node.arrived():
                take(message, arrival)
    found = Found(namespace.rstrip("/"), topics, {name: sorted(heard.names) for name, heard in joints.items()})
    text, remarks = guessed(found)
    try:
        write_atomically(text, path)
    except OSError as error:
        raise CommandError(f"{path}: cannot be written: {error.strerror}") from error
    print(f"Wrote {path}. Read it, and mend what is marked with 'CHECK'.")
    for remark in remarks:
        print(f"  {remark}")
    return 0


def _topics(ros: Any, namespace: str) -> Sequence[Topic]:
    """Return the topics below a namespace, once no new ones appear."""
    known: list[Topic] = []
    began = changed = time.monotonic()
    while time.monotonic() - began < LOOKING and (not known or time.monotonic() - changed < SETTLED):
        time.sleep(0.2)
        now = _topics_now(ros, namespace)
        if len(now) != len(known):
            known, changed = now, time.monotonic()
    if not known:
        where = f"below {namespace}" if namespace else "at all"
        raise CommandError(
            f"There are no topics {where}. Is the robot on, and are --domain-id and --range right? A robot with a "
            "computer of its own needs --range subnet."
        )
    return known


def _topics_now(ros: Any, namespace: str) -> list[Topic]:
    found = []
    for name, kinds in ros.get_topic_names_and_types():
        if name.startswith(f"{namespace}/") and len(kinds) == 1:
            publishers = ros.get_publishers_info_by_topic(name)
            reliable = all(one.qos_profile.reliability.name == "RELIABLE" for one in publishers)
            found.append(
                Topic(name, kinds[0], bool(publishers), bool(ros.get_subscriptions_info_by_topic(name)), reliable)
            )
    return found
