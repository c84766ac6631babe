"""The topics of robots shown in ROS 2, and the clock of a replayed log."""

from cmr.bus.message import Message
from cmr.bus.messages import now_utime
from cmr.bus.process import Process
from cmr.msg import range_scan_t, world_state_t
from robot_driver.ros2.messages import (
    CLOCK,
    JOINT_STATE,
    LASER_SCAN,
    ODOMETRY,
    TRANSFORM,
    TRANSFORMS,
    TWIST,
    TWIST_STAMPED,
    Placed,
    Ros,
    read_twist,
    read_twist_stamped,
    write_joints,
    write_odometry,
    write_scan,
    write_time,
    write_transform,
)
from robot_driver.ros2.node import Node, Publisher, has_type, type_of
from robot_driver.ros2.profile import TF, TF_STATIC
from robot_driver.ros2.shown import ShownRobot, State

SCAN_PERIOD = 0.1  # s; cmr-sim scans all rays at once, ten times a second
NO_TF = "No tf is published: its type tf2_msgs is not installed. Source a ROS 2 for it."


class Stage:
    """Shows robots in ROS 2, each in a namespace of its own: /robot_10/odom."""

    def __init__(self, robots: list[ShownRobot], node: Node, process: Process, *, stamped: bool) -> None:
        self._robots = {robot.robot_id: robot for robot in robots}
        self._process = process
        self._topics = {robot.robot_id: _Topics(robot, node) for robot in robots}
        self._tf: Publisher | None = None
        self.remark = "" if has_type(TRANSFORMS) else NO_TF
        if has_type(TRANSFORMS):
            self._tf = node.publisher(TF, TRANSFORMS)
            self._anchors = node.publisher(TF_STATIC, TRANSFORMS, latched=True)
            self._anchors.publish(_transforms(self._anchors, [robot.anchor for robot in robots]))
        for robot in robots:
            kind = TWIST_STAMPED if stamped else TWIST
            node.hear(f"/{robot.name}/cmd_vel", kind, _Taker(process, robot, stamped), reliable=False)

    def handle(self, utime: int, channel: str, message: Message) -> None:
        """Process a message of the bus, and publish its content."""
        if isinstance(message, world_state_t):
            now = now_utime()
            states = [(robot, robot.state(message, now)) for robot in self._robots.values()]
            self._show([(robot, state) for robot, state in states if state is not None])
        elif isinstance(message, range_scan_t):
            if message.robot_id in self._topics:
                self._topics[message.robot_id].show_scan(message)
        else:
            for robot in self._robots.values():
                robot.handle(utime, channel, message)

    def turn(self, now: int) -> None:
        """Claim the robots that ROS 2 commands, and release the others."""
        for robot in self._robots.values():
            self._process.publish_all(robot.turn(now))

    def leave(self, now: int) -> None:
        """Stop the robots that ROS 2 commands, and release them."""
        for robot in self._robots.values():
            self._process.publish_all(robot.end(now))

    def problem(self, now: int) -> str:
        """Return what prevents robots from being shown or commanded, in sentences."""
        return " ".join(filter(None, (robot.problem(now) for robot in self._robots.values())))

    def _show(self, states: list[tuple[ShownRobot, State]]) -> None:
        for robot, state in states:
            self._topics[robot.robot_id].show(state)
        if self._tf is not None and states:
            self._tf.publish(_transforms(self._tf, [state.transform for _, state in states]))


class ReplayClock:
    """Serves /clock for nodes with use_sim_time: the newest time of a message of the world."""

    def __init__(self, node: Node) -> None:
        self._publisher = node.publisher("/clock", CLOCK)
        self._message = self._publisher.empty()

    def handle(self, utime: int, _channel: str, message: Message) -> None:
        """Process a message of the bus."""
        if isinstance(message, world_state_t):
            write_time(self._message.clock, utime)
            self._publisher.publish(self._message)


class _Topics:
    """The publishers of one robot."""

    def __init__(self, robot: ShownRobot, node: Node) -> None:
        self._robot = robot
        self._odometry = node.publisher(f"/{robot.name}/odom", ODOMETRY)
        self._joints = node.publisher(f"/{robot.name}/joint_states", JOINT_STATE)
        self._scan = node.publisher(f"/{robot.name}/scan", LASER_SCAN)
        self._messages = self._odometry.empty(), self._joints.empty(), self._scan.empty()

    def show(self, state: State) -> None:
        odometry, joints, _ = self._messages
        write_odometry(odometry, state.odometry)
        self._odometry.publish(odometry)
        write_joints(joints, state.joints)
        self._joints.publish(joints)

    def show_scan(self, scan: range_scan_t) -> None:
        message = self._messages[2]
        write_scan(message, scan, self._robot.frame, SCAN_PERIOD)
        self._scan.publish(message)


class _Taker:
    """Passes velocities from ROS 2 to the robot."""

    def __init__(self, process: Process, robot: ShownRobot, stamped: bool) -> None:
        self._process, self._robot, self._stamped = process, robot, stamped

    def __call__(self, message: Ros, arrival: int) -> None:
        velocity = read_twist_stamped(message)[1] if self._stamped else read_twist(message)
        self._process.publish_all(self._robot.drive(velocity, arrival))


def _transforms(publisher: Publisher, placed: list[Placed]) -> Ros:
    message = publisher.empty()
    kind = type_of(TRANSFORM)
    for one in placed:
        transform = kind()
        write_transform(transform, one)
        message.transforms.append(transform)
    return message
