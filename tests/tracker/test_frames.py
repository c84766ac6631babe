"""Poses in the plane are those of the robots, whatever axes, units and offsets the tracker has."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("qtm_rt", reason="the extra [tracker] is not installed")
from cmr.tracker.frames import Plane, Sample
from cmr.tracker.profile import Carried, Frame, Limits, Profile, Tracker
from cmr.tracker.qualisys import quaternion_of

angles = st.floats(-math.pi, math.pi)
metres = st.floats(-10.0, 10.0)


def plane(carried: Carried, *, up: str = "z", unit: str = "m", frame: Frame | None = None) -> Plane:
    return Plane(Profile(Tracker("mock", "x", up=up, unit=unit), {7: carried}, Limits(), frame or Frame()))


def sample(*bodies: tuple[str, list[float], list[float]]) -> Sample:
    names, positions, quaternions = zip(*bodies, strict=True)
    return Sample(0, None, None, tuple(names), np.array(positions, float), np.array(quaternions, float), "here")


def turned(theta: float) -> list[float]:
    return [0.0, 0.0, math.sin(theta / 2.0), math.cos(theta / 2.0)]


@given(metres, metres, angles)
def test_with_y_upwards_and_millimetres_the_pose_is_the_same(x: float, y: float, theta: float) -> None:
    of_z = plane(Carried("a")).poses(sample(("a", [x, y, 0.1], turned(theta))))
    qx, qy, qz, qw = turned(theta)
    of_y = plane(Carried("a"), up="y", unit="mm").poses(sample(("a", [x * 1e3, 100.0, -y * 1e3], [qx, qz, -qy, qw])))
    assert of_z[0][1:3] == pytest.approx((x, y), abs=1e-9)
    assert math.remainder(of_z[0].theta - theta, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-9)
    assert of_y[0][1:3] == pytest.approx(of_z[0][1:3], abs=1e-9)
    assert math.remainder(of_y[0].theta - of_z[0].theta, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-9)


@given(metres, metres, angles, metres, metres, angles)
def test_the_offset_of_the_body_is_taken_off(
    x: float, y: float, theta: float, dx: float, dy: float, dtheta: float
) -> None:
    c, s = math.cos(theta), math.sin(theta)
    body = ("a", [x + c * dx - s * dy, y + s * dx + c * dy, 0.0], turned(theta + dtheta))
    (pose,) = plane(Carried("a", dx, dy, dtheta)).poses(sample(body))
    assert pose[:3] == pytest.approx((7, x, y), abs=1e-6)
    assert math.remainder(pose.theta - theta, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-6)


def test_the_trackers_frame_is_turned_into_the_world() -> None:
    (pose,) = plane(Carried("a"), frame=Frame(1.0, 2.0, math.pi / 2)).poses(sample(("a", [3.0, 0.0, 0.0], turned(0.1))))
    assert pose[1:] == pytest.approx((1.0, 5.0, math.pi / 2 + 0.1))


@pytest.mark.parametrize(
    ("position", "quaternion"),
    [
        ([0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0]),
        ([math.nan, 0.0, 0.0], turned(0.0)),
        ([0.0, math.inf, 0.0], turned(0.0)),
        ([0.0, 0.0, 0.0], [math.nan, 0.0, 0.0, 1.0]),
        ([0.0, 0.0, 0.0], [math.sin(0.3), 0.0, 0.0, math.cos(0.3)]),  # leans by 0.6 rad
        ([0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]),  # upside down
    ],
)
def test_a_body_that_has_no_pose_or_does_not_stand_gives_none(position: list[float], quaternion: list[float]) -> None:
    made = plane(Carried("a"))
    assert made.poses(sample(("a", position, quaternion), ("b", [0.0] * 3, turned(0.0)))) == []
    assert 7 in made.wrong


def test_of_two_bodies_with_the_name_of_a_robot_neither_counts() -> None:
    made = plane(Carried("a"))
    assert made.poses(sample(("a", [0.0] * 3, turned(0.0)), ("a", [1.0, 0.0, 0.0], turned(0.0)))) == []
    assert made.wrong == {7: "two bodies have its name"}


@given(st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=4).filter(lambda q: math.hypot(*q) > 0.1))
def test_a_rotation_matrix_and_its_quaternion_are_the_same_turn(quaternion: list[float]) -> None:
    x, y, z, w = np.array(quaternion) / np.linalg.norm(quaternion)
    matrix = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    found = quaternion_of(matrix.T.ravel().tolist())
    assert abs(float(np.dot(found, [x, y, z, w]))) == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize("wrong", [[math.nan] * 9, [0.0] * 4 + [math.nan] + [0.0] * 4])
def test_of_a_matrix_that_has_no_numbers_the_pose_is_none(wrong: list[float]) -> None:
    assert all(math.isnan(value) for value in quaternion_of(wrong))
