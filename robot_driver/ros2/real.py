"""The topics of one real robot: those that its bridge receives and sends."""

from cmr.bus.process import Process, Timer
from robot_driver.ros2.bridge import RobotBridge
from robot_driver.ros2.messages import TRANSFORMS, TWIST_STAMPED, Ros, Velocity, write_twist, write_twist_stamped
from robot_driver.ros2.node import Node, has_type
from robot_driver.ros2.profile import TF, TF_STATIC

# Repeated at the end, as one can be lost. An acknowledgement may take 3 s, the period of Fast DDS's heartbeat: too long
# to wait.
LAST_ZEROS, BETWEEN_ZEROS = 5, 0.02  # and s
NO_TF = "The pose is to come from tf, whose type tf2_msgs is not installed: source a ROS 2."


class RealRobot:
    """A bridge with its topics, in the namespace of its robot; `publish` sends the current velocity."""

    def __init__(self, bridge: RobotBridge, namespace: str, node: Node, process: Process) -> None:
        self.bridge = bridge
        self._node, self._process, self._namespace = node, process, namespace
        self._command = bridge.profile.command
        self._publisher = node.publisher(self._topic(self._command.topic), self._command.type)
        self._stamped = self._command.type == TWIST_STAMPED
        self._message = self._publisher.empty()
        self._due = Timer(1.0 / self._command.rate)
        self._problem = ""
        self._subscribe()

    def publish(self, utime: int) -> None:
        """Send the robot its current velocity."""
        self._send(self.bridge.velocity(), utime)

    def publish_if_due(self, utime: int) -> None:
        """Send it if the robot's rate requires it; the process runs at the rate of the fastest."""
        if self._due.due():
            self.publish(utime)

    def look(self) -> None:
        """Check which other nodes use the robot's topics."""
        others = self._node.others_publish(self._publisher.topic, own=1)
        problems = [self._problem]
        if others:
            problems.append(
                f"Another node publishes {self._publisher.topic}: what it sends passes by the emergency stop and all "
                "other promises. End it."
            )
        if not self._publisher.heard_by:
            problems.append(f"No node takes {self._publisher.topic} ({self._command.type}).")
        self.bridge.graph_problem = " ".join(filter(None, problems))

    def stop(self, utime: int) -> bool:
        """Send the robot its last zero; return whether there is a subscriber."""
        self._send(self.bridge.stop(), utime)
        return self._publisher.heard_by > 0

    def _send(self, velocity: Velocity, utime: int) -> None:
        if self._stamped:
            write_twist_stamped(self._message, utime, self._command.frame, velocity)
        else:
            write_twist(self._message, velocity)
        self._publisher.publish(self._message)

    def _subscribe(self) -> None:
        profile, readings = self.bridge.profile, self.bridge.readings
        wheels = profile.wheels
        self._hear(wheels.topic, wheels.type, readings.wheels, wheels.reliability)
        if profile.gyro is not None:
            self._hear(profile.gyro.topic, profile.gyro.type, readings.gyro, profile.gyro.reliability)
        if profile.pose is None:
            return
        if profile.pose.topic:
            self._hear(profile.pose.topic, profile.pose.type, readings.pose, profile.pose.reliability)
        elif has_type(TRANSFORMS):
            for topic, latched in ((TF, False), (TF_STATIC, True)):
                self._node.hear(topic, TRANSFORMS, self._take_transforms, reliable=True, latched=latched)
        else:
            self._problem = NO_TF

    def _hear(self, topic: str, kind: str, take: object, reliability: str) -> None:
        assert callable(take)

        def arrived(message: Ros, arrival: int) -> None:
            self._process.publish_all(take(message, arrival))

        self._node.hear(self._topic(topic), kind, arrived, reliable=reliability == "reliable")

    def _take_transforms(self, message: Ros, arrival: int) -> None:
        self._process.publish_all(self.bridge.readings.transforms(message.transforms, arrival))

    def _topic(self, name: str) -> str:
        return name if name.startswith(("/", "~")) else f"{self._namespace}/{name}"
