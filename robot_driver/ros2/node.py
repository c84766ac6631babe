"""A minimal ROS 2 node: topics in and out, messages with their times of arrival, and other nodes."""

import importlib
import time
from collections import deque
from collections.abc import Callable
from threading import Event, Thread
from types import TracebackType
from typing import Any, NamedTuple

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions

from robot_driver.ros2.messages import Ros

DEPTH = 1000  # messages queued while this computer is busy; some seconds' worth for one robot
MOST_WAITING = 100_000  # messages in all, after which the oldest are dropped
LONGEST_WAIT = 0.1  # s between two checks whether to end


class Arrived(NamedTuple):
    """A message of ROS 2: its handler, and its time of arrival [us]."""

    take: Callable[[Ros, int], object]
    message: Ros
    utime: int


def type_of(name: str) -> Any:
    """Return the class of a message type, such as geometry_msgs/msg/Twist. Raises ModuleNotFoundError."""
    package, _, kind = name.split("/")
    return getattr(importlib.import_module(f"{package}.msg"), kind)


def has_type(name: str) -> bool:
    """Return whether the package of a type is installed."""
    try:
        type_of(name)
    except ModuleNotFoundError:
        return False
    return True


class Node:
    """A node with this name, as a context manager; `wake` is called, in another thread, when something has arrived.

    `arrived` returns messages; `lost` counts those dropped because they waited too long.
    """

    def __init__(self, name: str, wake: Callable[[], object]) -> None:
        self.lost = 0
        self._wake = wake
        self._waiting: deque[Arrived] = deque()
        self._context = rclpy.Context()
        rclpy.init(context=self._context, signal_handler_options=SignalHandlerOptions.NO)
        self.ros = rclpy.create_node(name, context=self._context, enable_rosout=False, start_parameter_services=False)
        self._executor = _executor(self._context)
        self._executor.add_node(self.ros)
        self._over = Event()
        self._thread = Thread(target=self._spin, name="ROS 2", daemon=True)

    def __enter__(self) -> "Node":
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._over.set()
        self._executor.wake()
        self._thread.join(1.0)
        self._executor.shutdown(timeout_sec=1.0)
        self.ros.destroy_node()
        self._context.try_shutdown()

    def hear(
        self, topic: str, kind: str, take: Callable[[Ros, int], object], *, reliable: bool, latched: bool = False
    ) -> None:
        """Have `take(message, arrival)` called for each message, in the thread that calls `arrived`."""

        def arrived(message: Ros) -> None:
            if len(self._waiting) >= MOST_WAITING:
                self._waiting.popleft()
                self.lost += 1
            self._waiting.append(Arrived(take, message, time.time_ns() // 1000))
            self._wake()

        self.ros.create_subscription(type_of(kind), topic, arrived, _quality(reliable, latched))

    def publisher(self, topic: str, kind: str, *, reliable: bool = True, latched: bool = False) -> "Publisher":
        """Return a publisher for a topic."""
        return Publisher(self.ros, topic, kind, _quality(reliable, latched))

    def arrived(self) -> list[Arrived]:
        """Return the messages since the last call, oldest first."""
        return [self._waiting.popleft() for _ in range(len(self._waiting))]

    def others_publish(self, topic: str, own: int) -> int:
        """Return how many publishers a topic has besides this node's own."""
        return max(int(self.ros.count_publishers(topic)) - own, 0)

    def _spin(self) -> None:
        while not self._over.is_set():
            self._executor.spin_once(timeout_sec=LONGEST_WAIT)


class Publisher:
    """Publishes on one topic; `empty` creates a message to fill in."""

    def __init__(self, node: Any, topic: str, kind: str, quality: QoSProfile) -> None:
        self.empty: Callable[[], Ros] = type_of(kind)
        self._publisher = node.create_publisher(self.empty, topic, quality)
        self.topic: str = self._publisher.topic_name
        self.publish: Callable[[Ros], None] = self._publisher.publish

    @property
    def heard_by(self) -> int:
        """Number of subscribers."""
        return int(self._publisher.get_subscription_count())


def _executor(context: Any) -> Any:
    """Return the executor; from ROS 2 Kilted on, one that does not rebuild its wait set for each message."""
    try:
        from rclpy.experimental import EventsExecutor
    except ImportError:
        return SingleThreadedExecutor(context=context)
    return EventsExecutor(context=context)


def _quality(reliable: bool, latched: bool) -> QoSProfile:
    return QoSProfile(
        depth=1 if latched else DEPTH,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )
