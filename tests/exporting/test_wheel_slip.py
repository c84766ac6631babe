"""What cmr-export writes for Gazebo's WheelSlip lets wheels slip there as the model's do, as far as they can."""

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from cmr.exporting.carried import SDF, URDF, Carry, of_robot
from cmr.exporting.diff_drive import Described, calibrated
from cmr.exporting.export import export
from cmr.exporting.gazebo import sdf
from cmr.exporting.gazebo import urdf as urdf_of
from cmr.exporting.robot import ExportedRobot
from cmr.model.parameters import RobotParameters
from cmr.recordings.signal import Floats
from tests.exporting.exported_robots import PAPER
from tests.support.gazebo_wheels import driven, wheels_of

MASS, DT = 3.0, 1e-3  # kg; s
RADIUS, _, K1, WIDTH = PAPER
TOP = RADIUS / K1  # m/s
SAID = Described(WIDTH, RADIUS)


def robot(**effects: float) -> ExportedRobot:
    return ExportedRobot(0, RobotParameters(*PAPER, effects=effects), mass=MASS)


def driven_there(one: ExportedRobot, left: Floats, right: Floats) -> Floats:
    """Return how the body moves (n, 3) with wheels at these speeds [m/s], as the exported text has them slip."""
    model = ElementTree.fromstring(f"<model>{sdf(one, SAID)}</model>")
    return driven(wheels_of(model), WIDTH, MASS, np.stack([left, right], axis=1) / RADIUS, DT)


@pytest.mark.parametrize("slip", [0.005, 0.02, 0.06])
@pytest.mark.parametrize("seconds", [2.0, 6.0])
def test_speeding_up_to_the_top_speed_loses_the_same_way(slip: float, seconds: float) -> None:
    """By the slip s of the rim against the body: way lost = slip TOP (1 + twice the mean of s / TOP)."""
    rim = np.minimum(np.arange(DT, seconds + 2.0, DT) * TOP / seconds, TOP)
    along = driven_there(robot(longitudinal_slip=slip), rim, rim)[:, 0]
    lost = DT * float(np.sum(rim - along))
    beyond = 2.0 * float(np.max(rim - along)) / TOP
    assert along[-1] == pytest.approx(TOP, rel=1e-3)
    assert slip * TOP * (1.0 - 1e-3) <= lost <= slip * TOP * (1.0 + beyond)
    assert beyond < 0.2


@pytest.mark.parametrize("speed", [0.25, 0.5, 0.75])
@pytest.mark.parametrize("rate", [-0.5, 1.0])
def test_in_turns_the_robot_skids_outwards_as_far_as_its_speed_is_of_half_the_top_speed(
    speed: float, rate: float
) -> None:
    """Both wheels hold the body: of the speed, the harmonic mean of both rims counts, v (1 - (omega b / 2 v)^2)."""
    skid, along = 0.06, speed * TOP
    ends = np.full(2000, along)
    across = driven_there(robot(lateral_skid=skid), ends - rate * WIDTH / 2.0, ends + rate * WIDTH / 2.0)[-1, 1]
    counted = 1.0 - (rate * WIDTH / 2.0 / along) ** 2
    assert across == pytest.approx(-skid * along * rate * (speed / 0.5) * counted, rel=1e-6)


def test_a_steady_turn_is_as_fast_as_without_slip_which_is_why_turn_slip_is_not_carried() -> None:
    spin = np.full(8000, 0.2)
    rate = driven_there(robot(longitudinal_slip=0.06, lateral_skid=0.06), -spin, spin)[:, 2]
    assert rate[0] < 0.9 * 0.4 / WIDTH
    assert rate[-1] == pytest.approx(0.4 / WIDTH, rel=1e-6)
    found = of_robot(SDF, robot(turn_slip=0.03, longitudinal_slip=0.02))
    assert (found["turn_slip"].how, found["longitudinal_slip"].how) == (Carry.NOT, Carry.APPROXIMATELY)


def test_each_wheel_has_its_radius_and_half_of_the_weight() -> None:
    one = robot(lateral_skid=0.1, wheel_radius_asymmetry=0.01, wheel_radius_scale=0.02)
    known = calibrated(one)
    left, right = wheels_of(ElementTree.fromstring(f"<model>{sdf(one, SAID)}</model>"))
    assert (left.radius, right.radius) == pytest.approx((known.radius_left, known.radius_right), rel=1e-5)
    assert left.load + right.load == pytest.approx(MASS * 9.81)
    assert left.longitudinal == 0.0
    assert left.lateral == pytest.approx(0.1 * 9.81 / (known.speed / 2.0), rel=1e-5)


def test_a_urdf_has_the_same_system_and_says_along_what_wheels_slip() -> None:
    namespace = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'
    one = robot(longitudinal_slip=0.02)
    document = ElementTree.fromstring(f"<robot {namespace}>{urdf_of(one, SAID)}</robot>")
    assert wheels_of(document) == wheels_of(ElementTree.fromstring(f"<model>{sdf(one, SAID)}</model>"))
    surfaces = {str(part.get("reference")): part.findtext("fdir1") for part in document.findall("gazebo")}
    assert surfaces == {"None": None, "left_wheel_link": "0 0 1", "right_wheel_link": "0 0 1"}


@pytest.mark.parametrize("target", [SDF, URDF])
def test_a_robot_that_does_not_slip_or_whose_mass_is_not_known_has_no_such_system(target: str, tmp_path: Path) -> None:
    weighed, unknown = robot(turn_slip=0.03), replace(robot(lateral_skid=0.1), mass=None)
    for one in (weighed, unknown):
        export(one, target, tmp_path / "robot.xml")
        assert "::WheelSlip" not in (tmp_path / "robot.xml").read_text()
    said = " ".join((tmp_path / "robot.xml").read_text().split())
    assert "give cmr-export the robot's mass" in said
    assert of_robot(target, unknown)["lateral_skid"].how is Carry.NOT
