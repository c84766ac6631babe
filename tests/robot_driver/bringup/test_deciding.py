"""What is decided from what was seen and counted, and what is not."""

import cmath
import math
import re
from itertools import accumulate, pairwise, product
from pathlib import Path
from random import Random

import pytest
import yaml

from cmr.cli.errors import CommandError
from cmr.msg import motor_feedback_t
from cmr.parameters.file import load as load_parameters
from robot_driver.bringup import Known, load
from robot_driver.bringup.bench import CannotTell
from robot_driver.bringup.motors import Observation, Side, decided
from robot_driver.bringup.odometry import Path as Way
from robot_driver.bringup.parameters import ParametersFound, write_parameters
from robot_driver.bringup.poses import Pose, judged
from robot_driver.bringup.poses_found import PosesFound
from robot_driver.bringup.stopping import bound, was_driven
from robot_driver.bringup.turning import judged as judged_gyro
from robot_driver.bringup.turns import Count, agreed, miscounted, nearest, objection
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
        (((300, 290), (310, 300)), "both encoders counted"),
    ],
)
def test_contradictions_decide_nothing(counts: tuple[tuple[int, int], tuple[int, int]], why: str) -> None:
    with pytest.raises(CannotTell, match=why):
        decided(Observation(Side.LEFT, 1, counts[0], 0.1), Observation(Side.RIGHT, 1, counts[1], 0.1))


def test_a_wheel_that_shakes_while_that_of_a_dead_encoder_turns_is_not_counted() -> None:
    """Two robots of the study had a dead encoder, and the other wheel shook by a few ticks."""
    found = decided(Observation(Side.RIGHT, 1, (0, 520), 0.1), Observation(Side.LEFT, 1, (0, -5), 0.1))
    assert found.dead == (Side.LEFT,)
    assert found.wiring == Wiring(swap=True, swap_encoders=True)


def test_ten_turns_show_pulses_for_counts_and_a_miscounted_turn() -> None:
    assert [nearest(2048 * share, 2048) for share in (0.993, 1.99, 4.02, 0.5, 0.251)] == [1.0, 2.0, 4.0, 0.5, 0.25]
    assert nearest(2048 * 0.9, 2048) is None
    assert nearest(2048 * 3.0, 2048) is None
    assert miscounted(4.0 * 2048 * 0.9, 2048, 10)[1] == "nine"
    assert miscounted(2048 * 8 / 7, 2048, 7)[1] == "eight"
    assert miscounted(2048 * 3.0, 2048, 10) == (3.0, "")


def counts_of(*per_turn: float, sides: tuple[Side, ...]) -> list[Count]:
    """What rounds of ten and of seven turns counted for a turn, side by side."""
    rounds = [(10, 7)[number // len(sides) % 2] for number in range(len(per_turn))]
    return [
        Count(sides[k % len(sides)], turns, value)
        for k, (turns, value) in enumerate(zip(rounds, per_turn, strict=True))
    ]


def test_without_a_data_sheet_ten_turns_and_seven_have_to_agree() -> None:
    """A robot of the study had 1200 counts, and nine turns counted for ten, twice, were believed."""
    one, both = (Side.LEFT,), (Side.LEFT, Side.RIGHT)
    assert agreed(counts_of(1200.0, sides=one), one, 0.0) is None
    assert agreed(counts_of(1203.0, 1198.0, sides=one), one, 0.0) == pytest.approx(1200.5)
    for wrong, again in product((9 / 10, 11 / 10), (6 / 7, 8 / 7)):
        assert agreed(counts_of(1200.0 * wrong, 1200.0 * again, sides=one), one, 0.0) is None
    assert agreed(counts_of(1200.0, 1080.0, 1029.0, 1200.0, sides=both), both, 0.0) == pytest.approx(1200.0)
    assert agreed(counts_of(1200.0, 2400.0, 1200.0, 2400.0, sides=both), both, 0.0) is None
    assert agreed(counts_of(1200.0, 1200.0, sides=both), both, 600.0) == pytest.approx(1200.0)
    assert agreed(counts_of(1080.0, 1080.0, sides=both), both, 1200.0) is None
    assert "nothing to compare" in objection(counts_of(1200.0, sides=one), 0.0, first=True)
    assert "nine turns were made" in objection(counts_of(1080.0, sides=one), 1200.0, first=True)
    assert "The wheels differ" in objection(counts_of(1200.0, 1320.0, sides=both), 0.0, first=True)


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


def test_only_a_cable_that_is_pulled_while_the_wheels_are_driven_shows_a_stop() -> None:
    last = motor_feedback_t()
    last.applied_left, last.applied_right, last.received_utime = 0.1, 0.0999, 10**9
    assert was_driven(last, 0.1, until=10**9 + 200_000)
    assert not was_driven(last, 0.1, until=10**9 + 20_000)  # zero was on its way
    last.applied_right = 0.0
    assert not was_driven(last, 0.1, until=10**9 + 200_000)


def way() -> Way:
    """The planned drive, at 50 Hz."""
    times, places, headings = [0.0], [0j], [0.0]
    rest = (0.5, 0, 0)
    for seconds, speed, rate in [
        *(rest, (4, 0.125, 0), rest, (2, 0, math.pi / 4)),
        *(rest, (2, 0.125, 0), rest, (2, 0, -math.pi / 4), rest),
    ]:
        for _ in range(round(50 * seconds)):
            headings.append(headings[-1] + 0.02 * rate)
            places.append(places[-1] + 0.02 * speed * cmath.exp(1j * headings[-1]))
            times.append(times[-1] + 0.02)
    return Way(times, places, headings)


def shown(truth: PosesFound, random: Random) -> list[Pose]:
    """Poses of the planned drive as `truth` says, with 3 mm and 0.3 degrees of noise, in a frame turned by 2 rad."""
    path, poses = way(), []
    for number in range(625):
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
        assert found.lateness == pytest.approx(truth.lateness, abs=0.01)
        assert found.unclear == ""
        assert found.length == pytest.approx(1.0, abs=0.02)
    assert bool(found.corrections(0)) is (truth != PosesFound())


@pytest.mark.parametrize(("mistake", "lateness"), [("width", 0.0), ("wheels", 0.0), ("wheels", 0.3)])
def test_a_base_width_or_unequal_wheels_do_not_look_like_lateness(mistake: str, lateness: float) -> None:
    """Headings by the wheels are 3 % too large, or grow by 0.15 rad on each metre; poses were believed 42 ms late."""
    path = way()
    if mistake == "width":
        bent = [1.03 * heading for heading in path.headings]
    else:
        gone = [sum(abs(b - a) for a, b in pairwise(path.places[:k])) for k in range(1, len(path.places) + 1)]
        bent = [heading + 0.15 * metres for heading, metres in zip(path.headings, gone, strict=True)]
    steps = [abs(b - a) for a, b in pairwise(path.places)]
    places = accumulate(map(cmath.rect, steps, bent), initial=0j)
    found = judged(Way(path.times, list(places), bent), shown(PosesFound(lateness=lateness), Random(4)), {})
    assert found.lateness == pytest.approx(lateness, abs=0.01)


def test_corrections_name_the_setting_of_the_source() -> None:
    said = " ".join(PosesFound(1000.0, heading_offset=math.pi / 2, ahead=0.05, lateness=0.3).corrections(7))
    for setting in ("{unit: mm}", "{7: {theta: 1.571}}", "{7: {x: 0.050, y: 0.000}}", "{lag: 0.300}", "--lag 0.300"):
        assert setting in said
    assert "{up: y}" in PosesFound(vertical="y").corrections(0)[0]
    assert "cannot tell whether poses are late, because" in PosesFound(unsure_lateness=0.06).unclear


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
    with pytest.raises(CommandError, match=r"line 2: driver\.portt: the driver has no setting 'portt'"):
        load(path)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "line 1: is empty"),
        ("[1, 2]", "line 1: must be a mapping"),
        ("driver: {}\nfound: {}\n", "line 1: undecided is missing; a file of cmr bringup has driver, undecided, found"),
        ("driver: {}\nundecided: {}\nfound: {}\n", "line 2: undecided: must be a list"),
        ("driver: {}\nundecided: []\nfound:\n", "line 3: found: must be a mapping"),
        ("driver: {}\nundecided: []\nfound: {\n", "cannot be read"),
        ("driver:\n  port: a\n  port: b\nundecided: []\nfound: {}\n", "line 3: driver.port: is there twice"),
    ],
)
def test_an_error_in_a_settings_file_names_its_line(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "robot_0_driver.yaml"
    path.write_text(text)
    with pytest.raises(CommandError, match=f"^{re.escape(str(path))}: .*{said}"):
        options_in(path)


def test_a_tracked_point_ahead_and_beside_stands_in_the_parameters_until_it_is_corrected(tmp_path: Path) -> None:
    path = tmp_path / "robot_0.yaml"

    def written(poses: PosesFound) -> tuple[dict[str, float], tuple[str, ...]]:
        write_parameters(path, 0, ParametersFound(0.04, 0.16, None, 1.0, poses))
        file = load_parameters(path)
        return {name: value.value for name, value in file.values.items()}, file.effects

    robot = {"wheel_radius": 0.04, "base_width": 0.16}
    beside = {**robot, "pose_offset": 0.05, "pose_offset_lateral": -0.01}
    assert written(PosesFound(ahead=0.05, left=-0.01)) == (beside, ("pose_offset", "pose_offset_lateral"))
    assert written(PosesFound()) == (robot, ())
