"""A fake ROS 2 without other nodes, for fuzzing cmr-ros2: nothing is received, and rclpy is not needed."""

import sys
from collections.abc import Callable
from types import ModuleType, TracebackType
from typing import Any


class Message:
    """A message that accepts any field."""

    def __getattr__(self, name: str) -> "Message":
        if name.startswith("__"):
            raise AttributeError(name)
        field = Message()
        setattr(self, name, field)
        return field


class Publisher:
    """A publisher without subscribers."""

    heard_by = 0

    def __init__(self, topic: str) -> None:
        self.topic = topic
        self.empty = Message

    def publish(self, message: Message) -> None:
        """Discard the message."""


class Node:
    """A node that receives nothing."""

    lost = 0

    def __init__(self, name: str, wake: Callable[[], object]) -> None:
        del name, wake

    def __enter__(self) -> "Node":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Do nothing: there is nothing to close."""

    def hear(self, topic: str, kind: str, take: Callable[[Any, int], object], **quality: bool) -> None:
        """Accept a subscription; no message ever arrives."""

    def publisher(self, topic: str, kind: str, **quality: bool) -> Publisher:
        """Return a publisher without subscribers."""
        del kind, quality
        return Publisher(topic)

    def arrived(self) -> list[Any]:
        """Return the messages that arrived: none."""
        return []

    def others_publish(self, topic: str, own: int) -> int:
        """Return the number of other publishers on a topic: none."""
        del topic, own
        return 0


def install_fake_ros() -> None:
    """Replace robot_driver.ros2.node by the fake."""
    module: Any = ModuleType("robot_driver.ros2.node")
    module.Node, module.Publisher = Node, Publisher
    module.has_type, module.type_of = lambda _name: False, lambda _name: Message
    sys.modules["robot_driver.ros2.node"] = module
