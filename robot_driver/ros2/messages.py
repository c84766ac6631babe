"""Convert ROS 2 messages to planar quantities, and back: eight types, and the time.

Each type has a tuple of its planar quantities, a function that reads them from a message, and one that fills in a
message. A message is any object with the type's fields, such as those of rclpy or of rosbags. Everything else in a
message (heights, covariances, other axes) is neither read nor written. Frames, units and signs are those of REP 103,
which are the bus's: m, rad, s, x forward, y left, counter-clockwise positive.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple, TypeAlias

from cmr.bus.messages import make
from cmr.geometry.quaternions import heading, turned
from cmr.msg import range_scan_t

Ros: TypeAlias = Any  # a message of ROS 2

TWIST, TWIST_STAMPED = "geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped"
ODOMETRY, JOINT_STATE = "nav_msgs/msg/Odometry", "sensor_msgs/msg/JointState"
IMU, LASER_SCAN = "sensor_msgs/msg/Imu", "sensor_msgs/msg/LaserScan"
POSE_STAMPED, TRANSFORM = "geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/TransformStamped"
POSE_WITH_COVARIANCE = "geometry_msgs/msg/PoseWithCovarianceStamped"  # read only: its pose is that of a PoseStamped
TRANSFORMS = "tf2_msgs/msg/TFMessage"  # a list of TransformStamped
CLOCK = "rosgraph_msgs/msg/Clock"

SECOND = 1_000_000  # us
EARLIEST, LATEST = -(2**31) * SECOND, 2**31 * SECOND - 1  # us; the range of a stamp


class Velocity(NamedTuple):
    """Speed of a body [m/s] and its turn rate [rad/s]."""

    v: float
    omega: float


class Odometry(NamedTuple):
    """Pose by dead reckoning in the frame `parent` [m, rad], and velocity; time in us."""

    utime: int
    parent: str
    child: str
    x: float
    y: float
    theta: float
    v: float
    omega: float


class Joints(NamedTuple):
    """Angles [rad] and speeds [rad/s] of joints by name, either of which may be empty; time in us."""

    utime: int
    names: Sequence[str]
    positions: Sequence[float]
    velocities: Sequence[float]


class Placed(NamedTuple):
    """Pose of the frame `child` in the frame `parent` [m, rad]; a pose has no child. Time in us."""

    utime: int
    parent: str
    child: str
    x: float
    y: float
    theta: float


def read_time(time: Ros) -> int:
    """Return the time [us] of a builtin_interfaces Time; rounded down."""
    return int(time.sec) * SECOND + int(time.nanosec) // 1000


def write_time(time: Ros, utime: int) -> None:
    """Fill in a builtin_interfaces Time [us], clipped to its range."""
    seconds, microseconds = divmod(min(max(utime, EARLIEST), LATEST), SECOND)
    time.sec, time.nanosec = seconds, 1000 * microseconds


def read_twist(twist: Ros) -> Velocity:
    """Return the velocity in a Twist."""
    return Velocity(float(twist.linear.x), float(twist.angular.z))


def write_twist(twist: Ros, velocity: Velocity) -> None:
    """Fill in a Twist."""
    twist.linear.x, twist.angular.z = velocity


def read_twist_stamped(message: Ros) -> tuple[int, Velocity]:
    """Return the time [us] and the velocity of a TwistStamped."""
    return read_time(message.header.stamp), read_twist(message.twist)


def write_twist_stamped(message: Ros, utime: int, frame: str, velocity: Velocity) -> None:
    """Fill in a TwistStamped."""
    _write_header(message, utime, frame)
    write_twist(message.twist, velocity)


def read_odometry(message: Ros) -> Odometry:
    """Return the content of an Odometry."""
    position, orientation = message.pose.pose.position, message.pose.pose.orientation
    velocity = read_twist(message.twist.twist)
    place = float(position.x), float(position.y), _theta(orientation)
    return Odometry(read_time(message.header.stamp), message.header.frame_id, message.child_frame_id, *place, *velocity)


def write_odometry(message: Ros, odometry: Odometry) -> None:
    """Fill in an Odometry."""
    _write_header(message, odometry.utime, odometry.parent)
    message.child_frame_id = odometry.child
    _write_pose(message.pose.pose, odometry.x, odometry.y, odometry.theta)
    write_twist(message.twist.twist, Velocity(odometry.v, odometry.omega))


def read_joints(message: Ros) -> Joints:
    """Return the content of a JointState."""
    return Joints(read_time(message.header.stamp), list(message.name), list(message.position), list(message.velocity))


def write_joints(message: Ros, joints: Joints) -> None:
    """Fill in a JointState."""
    _write_header(message, joints.utime, "")
    message.name, message.position, message.velocity = list(joints.names), [*joints.positions], [*joints.velocities]


def read_imu(message: Ros) -> tuple[int, float]:
    """Return the time [us] of an Imu, and its turn rate about the z axis [rad/s]."""
    return read_time(message.header.stamp), float(message.angular_velocity.z)


def write_imu(message: Ros, utime: int, frame: str, yaw_rate: float) -> None:
    """Fill in an Imu that measures only the turn rate: the rest is marked as not available, as the type specifies."""
    _write_header(message, utime, frame)
    message.angular_velocity.z = yaw_rate
    message.orientation_covariance[0] = message.linear_acceleration_covariance[0] = -1.0


def read_pose(message: Ros) -> Placed:
    """Return the pose in a PoseStamped, or in a PoseWithCovarianceStamped."""
    pose = message.pose if hasattr(message.pose, "position") else message.pose.pose
    place = float(pose.position.x), float(pose.position.y), _theta(pose.orientation)
    return Placed(read_time(message.header.stamp), message.header.frame_id, "", *place)


def write_pose(message: Ros, placed: Placed) -> None:
    """Fill in a PoseStamped."""
    _write_header(message, placed.utime, placed.parent)
    _write_pose(message.pose, placed.x, placed.y, placed.theta)


def read_transform(message: Ros) -> Placed:
    """Return the content of a TransformStamped."""
    translation = message.transform.translation
    place = float(translation.x), float(translation.y), _theta(message.transform.rotation)
    return Placed(read_time(message.header.stamp), message.header.frame_id, message.child_frame_id, *place)


def write_transform(message: Ros, placed: Placed) -> None:
    """Fill in a TransformStamped."""
    _write_header(message, placed.utime, placed.parent)
    message.child_frame_id = placed.child
    message.transform.translation.x, message.transform.translation.y = placed.x, placed.y
    _write_theta(message.transform.rotation, placed.theta)


def read_scan(message: Ros, robot_id: int) -> range_scan_t:
    """Return a LaserScan as the scan of a robot that carries the sensor at its centre, pointing ahead.

    Invalid ranges, beyond `range_max` or below `range_min`, become inf: nothing within range.
    """
    least, most = float(message.range_min), float(message.range_max)
    ranges = [distance if least <= distance <= most else float("inf") for distance in message.ranges]
    return make(
        range_scan_t,
        utime=read_time(message.header.stamp),
        robot_id=robot_id,
        angle_first=float(message.angle_min),
        angle_step=float(message.angle_increment),
        range_max=most,
        ranges=ranges,
    )


def write_scan(message: Ros, scan: range_scan_t, frame: str, period: float) -> None:
    """Fill in a LaserScan; the sensor scans every `period` [s], all rays at once."""
    _write_header(message, scan.utime, frame)
    message.angle_min, message.angle_increment = scan.angle_first, scan.angle_step
    message.angle_max = scan.angle_first + scan.angle_step * max(scan.n - 1, 0)
    message.scan_time, message.range_min, message.range_max = period, 0.0, scan.range_max
    message.ranges = [float(distance) for distance in scan.ranges]


def _write_header(message: Ros, utime: int, frame: str) -> None:
    write_time(message.header.stamp, utime)
    message.header.frame_id = frame


def _write_pose(pose: Ros, x: float, y: float, theta: float) -> None:
    pose.position.x, pose.position.y = x, y
    _write_theta(pose.orientation, theta)


def _write_theta(rotation: Ros, theta: float) -> None:
    rotation.z, rotation.w = turned(theta)


def _theta(rotation: Ros) -> float:
    return heading(float(rotation.x), float(rotation.y), float(rotation.z), float(rotation.w))
