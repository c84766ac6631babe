"""Eight types of ROS 2 messages become numbers of the plane and messages again, without loss, also on the wire."""

import math
from typing import Any

import pytest

pytest.importorskip("rosbags", reason="the extra [ros] is not installed")
from hypothesis import given
from hypothesis import strategies as st

from cmr.bus.messages import make
from cmr.msg import range_scan_t
from robot_driver.ros2 import messages as ros
from tests.support import ros2_bench as bench

pytestmark = pytest.mark.slow
TIMES = st.integers(0, 2**31 * ros.SECOND - 1)  # us
NUMBERS = st.floats(allow_nan=False, allow_infinity=True)
ANGLES = st.floats(-math.pi, math.pi)
FRAMES = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=20)
SINGLES = st.floats(width=32, allow_nan=False, min_value=0.0)


def through(kind: str, fill: Any) -> Any:
    """Return a message that was filled in, and carried as bytes."""
    message = bench.empty(kind)
    fill(message)
    return bench.carried(kind, message)


def same_angle(one: float, other: float) -> bool:
    """Sine and cosine of half an angle are rounded to 2^-53 each, which moves it by four times that at most."""
    return abs(math.remainder(one - other, 2.0 * math.pi)) <= 4.0 * 2.0**-53 + 2.0 * math.ulp(math.pi)


@given(st.integers(ros.EARLIEST, ros.LATEST))
def test_a_time_comes_back(utime: int) -> None:
    time = bench.empty("builtin_interfaces/msg/Time")
    ros.write_time(time, utime)
    assert 0 <= time.nanosec < 10**9
    assert ros.read_time(time) == utime


@pytest.mark.parametrize("utime", [-(2**62), 2**62])
def test_a_time_that_no_stamp_can_say_becomes_the_nearest(utime: int) -> None:
    time = bench.empty("builtin_interfaces/msg/Time")
    ros.write_time(time, utime)
    assert ros.read_time(time) == (ros.EARLIEST if utime < 0 else ros.LATEST)


@given(NUMBERS, NUMBERS)
def test_a_twist_comes_back(v: float, omega: float) -> None:
    velocity = ros.Velocity(v, omega)
    assert ros.read_twist(through(ros.TWIST, lambda message: ros.write_twist(message, velocity))) == velocity


@given(TIMES, FRAMES, NUMBERS, NUMBERS)
def test_a_stamped_twist_comes_back(utime: int, frame: str, v: float, omega: float) -> None:
    velocity = ros.Velocity(v, omega)
    message = through(ros.TWIST_STAMPED, lambda one: ros.write_twist_stamped(one, utime, frame, velocity))
    assert ros.read_twist_stamped(message) == (utime, velocity)
    assert message.header.frame_id == frame


@given(st.builds(ros.Odometry, TIMES, FRAMES, FRAMES, NUMBERS, NUMBERS, ANGLES, NUMBERS, NUMBERS))
def test_odometry_comes_back(odometry: ros.Odometry) -> None:
    back = ros.read_odometry(through(ros.ODOMETRY, lambda one: ros.write_odometry(one, odometry)))
    assert back._replace(theta=odometry.theta) == odometry
    assert same_angle(back.theta, odometry.theta)


@given(TIMES, st.dictionaries(FRAMES, st.tuples(NUMBERS, NUMBERS), max_size=6))
def test_joints_come_back(utime: int, joints: dict[str, tuple[float, float]]) -> None:
    said = ros.Joints(utime, list(joints), [one for one, _ in joints.values()], [two for _, two in joints.values()])
    assert ros.read_joints(through(ros.JOINT_STATE, lambda one: ros.write_joints(one, said))) == said


@given(TIMES, FRAMES, NUMBERS)
def test_a_turn_rate_comes_back(utime: int, frame: str, rate: float) -> None:
    message = through(ros.IMU, lambda one: ros.write_imu(one, utime, frame, rate))
    assert ros.read_imu(message) == (utime, rate)
    # sensor_msgs/Imu: a first element of -1 says that there is no such measurement.
    assert (message.orientation_covariance[0], message.linear_acceleration_covariance[0]) == (-1.0, -1.0)


@given(TIMES, FRAMES, NUMBERS, NUMBERS, ANGLES)
def test_a_pose_comes_back(utime: int, frame: str, x: float, y: float, theta: float) -> None:
    placed = ros.Placed(utime, frame, "", x, y, theta)
    back = ros.read_pose(through(ros.POSE_STAMPED, lambda one: ros.write_pose(one, placed)))
    assert back._replace(theta=theta) == placed
    assert same_angle(back.theta, theta)


@given(TIMES, FRAMES, FRAMES, NUMBERS, NUMBERS, ANGLES)
def test_a_transform_comes_back(utime: int, parent: str, child: str, x: float, y: float, theta: float) -> None:
    placed = ros.Placed(utime, parent, child, x, y, theta)
    back = ros.read_transform(through(ros.TRANSFORM, lambda one: ros.write_transform(one, placed)))
    assert back._replace(theta=theta) == placed
    assert same_angle(back.theta, theta)


@given(TIMES, SINGLES, SINGLES, st.floats(width=32, min_value=0.125, max_value=1e3), st.data())
def test_a_scan_comes_back(utime: int, first: float, step: float, most: float, data: st.DataObject) -> None:
    within = st.one_of(st.floats(0.0, most, width=32), st.just(math.inf))  # the type's own precision
    first, step = min(first, 1e3), min(step, 1e3)
    scan = make(
        range_scan_t,
        utime=utime,
        robot_id=7,
        angle_first=first,
        angle_step=step,
        range_max=most,
        ranges=data.draw(st.lists(within, max_size=8)),
    )
    message = through(ros.LASER_SCAN, lambda one: ros.write_scan(one, scan, "base_link", 0.1))
    back = ros.read_scan(message, 7)
    assert [getattr(back, name) for name in scan.__slots__] == [getattr(scan, name) for name in scan.__slots__]
    assert message.angle_max == pytest.approx(first + step * max(scan.n - 1, 0), rel=1e-6)


def test_a_scan_has_no_ranges_that_the_sensor_disowns() -> None:
    message = bench.empty(ros.LASER_SCAN)
    message.range_min, message.range_max = 0.2, 3.0
    message.ranges = [0.1, 1.0, 3.5, math.nan, math.inf, -math.inf]
    assert list(ros.read_scan(message, 0).ranges) == [math.inf, 1.0, math.inf, math.inf, math.inf, math.inf]
