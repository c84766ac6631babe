"""A ROS 2 in which nobody is: what cmr-ros2 publishes is taken by nobody, and nothing comes. No rclpy is needed."""

import sys
from collections.abc import Callable
from types import ModuleType, TracebackType
from typing import Any


class Message:
    """A message with whatever fields somebody fills in."""

    def __getattr__(self, name: str) -> "Message":
        if name.startswith("__"):
            raise AttributeError(name)
        field = Message()
        setattr(self, name, field)
        return field


class Publisher:
    """Publishes to nobody."""

    heard_by = 0

    def __init__(self, topic: str) -> None:
        self.topic = topic
        self.empty = Message

    def publish(self, message: Message) -> None:
        """Forget it."""


class Node:
    """A node that hears nothing."""

    lost = 0

    def __init__(self, name: str, wake: Callable[[], object]) -> None:
        del name, wake

    def __enter__(self) -> "Node":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Leave nothing behind."""

    def hear(self, topic: str, kind: str, take: Callable[[Any, int], object], **quality: bool) -> None:
        """Wait in vain."""

    def publisher(self, topic: str, kind: str, **quality: bool) -> Publisher:
        """Return what publishes to nobody."""
        del kind, quality
        return Publisher(topic)

    def arrived(self) -> list[Any]:
        """Return nothing."""
        return []

    def others_publish(self, topic: str, own: int) -> int:
        """Return that nobody does."""
        del topic, own
        return 0


def put_ros() -> None:
    """Put this in the place of robot_driver.ros2.node."""
    module: Any = ModuleType("robot_driver.ros2.node")
    module.Node, module.Publisher = Node, Publisher
    module.has_type, module.type_of = lambda _name: False, lambda _name: Message
    sys.modules["robot_driver.ros2.node"] = module
