"""What is decided from what was seen and counted, and what is not."""

import cmath
import math
from itertools import product
from pathlib import Path
from random import Random

import pytest
import yaml

from cmr.cli.errors import CommandError
from cmr.msg import motor_feedback_t
from robot_driver.bringup import Known, load
from robot_driver.bringup.bench import CannotTell
from robot_driver.bringup.motors import Observation, Side, decided
from robot_driver.bringup.odometry import Path as Way
from robot_driver.bringup.poses import Pose, PosesFound, judged
from robot_driver.bringup.stopping import bound
from robot_driver.bringup.turning import judged as judged_gyro
from robot_driver.bringup.turns import miscounted, nearest, objection
from robot_driver.encoders import Wiring
from robot_driver.settings import options_in

COUNTED = 300  # ticks of a wheel while its motor turned
MODULUS = 2**32


def observed(wiring: Wiring, channel: int, dead: tuple[Side, ...] = ()) -> Observation:
    """What a person sees when one channel of a robot that is wired so gets a positive duty."""
    left, right = wiring.forward(*((1.0, 0.0) if channel == 0 else (0.0, 1.0)))
    side = Side.LEFT if left else Side.RIGHT
    way = 1 if (left or right) > 0 else -1
    for counts in ((first, second) for first in (-COUNTED, 0, COUNTED) for second in (-COUNTED, 0, COUNTED)):
        forward = [(count + MODULUS // 2) % MODULUS - MODULUS // 2 for count in wiring.forward_counts(*counts)]
        if forward == ([way * COUNTED, 0] if side is Side.LEFT else [0, way * COUNTED]):
            return Observation(side, way, (0, 0) if side in dead else counts, 0.1)
    raise AssertionError


@pytest.mark.parametrize("dead", [(), (Side.LEFT,), (Side.RIGHT,)])
def test_every_wiring_is_found_from_what_both_motors_do(dead: tuple[Side, ...]) -> None:
    for flags in product((False, True), repeat=6):
        wiring = Wiring(*flags)
        found = decided(observed(wiring, 0, dead), observed(wiring, 1, dead))
        assert found.dead == dead
        unknown = {f"invert_{side.value}_encoder": False for side in dead}  # of an encoder that never counts
        assert found.wiring == wiring._replace(**unknown)


@pytest.mark.parametrize(
    ("counts", "why"),
    [
        (((300, 290), (0, 300)), "both encoders counted"),
        (((0, 0), (1, -2)), "no encoder counts"),
        (((300, 0), (280, 3)), "same channel"),
    ],
)
def test_contradictions_decide_nothing(counts: tuple[tuple[int, int], tuple[int, int]], why: str) -> None:
    with pytest.raises(CannotTell, match=why):
        decided(Observation(Side.LEFT, 1, counts[0], 0.1), Observation(Side.RIGHT, 1, counts[1], 0.1))


def test_ten_turns_show_pulses_for_counts_and_a_miscounted_turn() -> None:
    assert [nearest(2048 * share, 2048) for share in (0.993, 1.99, 4.02, 0.5, 0.251)] == [1.0, 2.0, 4.0, 0.5, 0.25]
    assert nearest(2048 * 0.9, 2048) is None
    assert nearest(2048 * 3.0, 2048) is None
    assert miscounted(4.0 * 2048 * 0.9, 2048)[1] == "nine turns"
    assert miscounted(2048 * 1.1, 2048)[1] == "eleven turns"
    assert miscounted(2048 * 3.0, 2048) == (3.0, "")


def test_without_a_data_sheet_only_what_was_counted_twice_is_believed() -> None:
    """A robot of the study had 1200 counts, and nine turns counted after ten were believed."""
    one = [Side.LEFT]
    assert objection([1200.0], one, 0.0, None)
    assert objection([1080.0], one, 0.0, 1200.0)
    assert objection([1200.0, 1320.0], list(Side), 0.0, 1200.0)
    assert not objection([1203.0], one, 0.0, 1200.0)


def test_a_gyro_shows_sign_and_scale_or_no_whole_turn() -> None:
    assert [
        (found.inverted, found.scale) for turned in (352, -364, 183, -177) if (found := judged_gyro(turned, 0.0))
    ] == [
        (False, 1.0),
        (True, 1.0),
        (False, 0.5),
        (True, 0.5),
    ]
    assert [judged_gyro(turned, 0.0) for turned in (0.0, 90.0, 270.0, 480.0)] == [None] * 4


def test_the_stop_time_is_what_the_counts_gained_would_have_taken() -> None:
    def reading(seconds: float, ticks: int) -> motor_feedback_t:
        message = motor_feedback_t()
        message.utime, message.ticks_left, message.ticks_right = round(1e6 * seconds), ticks, -ticks
        return message

    before = [reading(0.02 * number, 20 * number) for number in range(50)]  # 1000 ticks/s
    assert bound(before, reading(4.0, before[-1].ticks_left + 400)) == pytest.approx(0.4)
    with pytest.raises(CannotTell, match="forgot"):
        bound(before, before[-1])


def way() -> Way:
    """The planned drive, at 50 Hz."""
    times, places, headings = [0.0], [0j], [0.0]
    for seconds, speed, rate in [
        (1, 0, 0),
        (4, 0.125, 0),
        (2, 0, math.pi / 4),
        (2, 0.125, 0),
        (2, 0, -math.pi / 4),
        (1, 0, 0),
    ]:
        for _ in range(50 * seconds):
            headings.append(headings[-1] + 0.02 * rate)
            places.append(places[-1] + 0.02 * speed * cmath.exp(1j * headings[-1]))
            times.append(times[-1] + 0.02)
    return Way(times, places, headings)


def shown(truth: PosesFound, random: Random) -> list[Pose]:
    """Poses of the planned drive as `truth` says, with 3 mm and 0.3 degrees of noise, in a frame turned by 2 rad."""
    path, poses = way(), []
    for number in range(590):
        stamp = 0.02 * number
        place, heading = path.at(stamp - truth.lateness)
        place = cmath.rect(1.0, 2.0) * (place + complex(truth.ahead, truth.left) * cmath.exp(1j * heading)) + (3 - 1j)
        place += complex(random.gauss(0, 0.003), random.gauss(0, 0.003))
        heading += 2.0 + random.gauss(0, 0.005)
        if truth.mirrored:
            place, heading = place.conjugate(), -heading
        heading = math.remainder(heading + truth.heading_offset, 2 * math.pi) * (
            180 / math.pi if truth.degrees else 1.0
        )
        if truth.vertical == "y":
            place = complex(place.real, 0.1)
        poses.append(Pose(stamp, truth.metre * place, heading))
    return poses


@pytest.mark.parametrize(
    "truth",
    [
        PosesFound(),
        PosesFound(mirrored=True, metre=1000.0),
        PosesFound(degrees=True, heading_offset=math.pi),
        PosesFound(heading_offset=-math.pi / 2, lateness=0.3),
        PosesFound(ahead=0.05, mirrored=True, degrees=True),
        PosesFound(ahead=-0.03, left=0.04, metre=100.0),
        PosesFound(vertical="y", metre=1000.0),
    ],
)
def test_what_is_wrong_with_poses_is_found(truth: PosesFound) -> None:
    found = judged(way(), shown(truth, Random(1)), {})
    assert (found.metre, found.degrees, found.mirrored, found.vertical) == (
        (1.0, False, False, "y") if truth.vertical == "y" else (truth.metre, truth.degrees, truth.mirrored, "z")
    )
    if truth.vertical == "z":
        assert abs(math.remainder(found.heading_offset - truth.heading_offset, 2 * math.pi)) < 0.03
        assert abs(complex(found.ahead - truth.ahead, found.left - truth.left)) < 0.008
        assert found.lateness == pytest.approx(truth.lateness, abs=0.02)
        assert found.length == pytest.approx(1.0, abs=0.02)
    assert bool(found.sentences()) is (truth != PosesFound())


def test_poses_of_another_body_are_none_of_this_robot_and_swapped_ones_are_named() -> None:
    still = [
        Pose(pose.time, complex(1, 2) + 0.003 * complex(math.sin(7 * n), math.cos(5 * n)), 0.5)
        for n, pose in enumerate(shown(PosesFound(), Random(1)))
    ]
    with pytest.raises(CannotTell, match="do not move as this robot does: they are of another body"):
        judged(way(), still, {3: still})
    with pytest.raises(CannotTell, match="those of robot 3 do: the bodies are swapped"):
        judged(way(), still, {3: shown(PosesFound(mirrored=True), Random(2))})


def test_settings_that_are_not_complete_are_not_driven_with(tmp_path: Path) -> None:
    path = tmp_path / "robot_0_driver.yaml"
    known = Known({"port": "/dev/motor", "swap": True, "gyro": None, "ticks_per_turn": 3744}, ["ticks"], {"duty": 0.1})
    known.save(path)
    assert load(path) == known
    with pytest.raises(CommandError, match="cmr bringup has still to decide ticks"):
        options_in(path)
    known.decide("ticks")
    known.save(path)
    assert options_in(path) == ["--port", "/dev/motor", "--swap", "--ticks-per-turn", "3744"]
    path.write_text(yaml.safe_dump({"driver": {"portt": 1}, "undecided": [], "found": {}}))
    with pytest.raises(CommandError, match="no setting 'portt'"):
        load(path)
