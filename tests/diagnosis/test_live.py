"""The live watch: what has changed is said, with its cause, soon after it did; and nothing where nothing has."""

import gc
import math
import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

import numpy as np
import pytest

from cmr.bus.streams import GYRO, MOTOR_FEEDBACK, PARAMETERS, POSE
from cmr.diagnosis.live import Watcher
from cmr.diagnosis.live.causes import CAUSES
from cmr.model.catalogue import CATALOGUE
from cmr.msg import motor_feedback_t
from cmr.parameters.file import ParameterFile, Value
from cmr.recordings.signal import Floats
from scripts.score_real_data import DATA, Importer
from tests.diagnosis.watched_drive import (
    CHANGE,
    END,
    TRUE,
    Said,
    driven,
    edited,
    eight,
    errands,
    follow,
    gone,
    halted,
    handled,
    held,
    messages,
    slipping,
    undisturbed,
    watch,
    without,
)
from tests.reference_plant import NEUTRAL, REALISTIC, drive, packets
from tests.reference_plant.drives import START_UTIME
from tests.reference_plant.manoeuvres import Manoeuvre, constant, in_turn, reversals
from tests.support.lanes import further

pytestmark = pytest.mark.slow

SEEN_BY = CHANGE + 15.0  # s


def only(said: Said, *words: str, before: float = SEEN_BY) -> str:
    """The only sentence said; it has these words, and comes in time."""
    assert len(said) == 1, said
    time, sentence = said[0]
    assert CHANGE < time < before, said
    for word in words:
        assert word in sentence
    return sentence


def told_per_cent(sentence: str) -> int:
    """The first size that a sentence tells [%]."""
    return int(sentence.split(" % ")[0].split()[-1])


@pytest.mark.parametrize("seed", [1, *further(2)])
@pytest.mark.parametrize("manoeuvre", [eight(300.0), errands(300.0, 5)], ids=["eight", "errands"])
def test_twenty_minutes_in_which_nothing_changes_bring_no_sentence(manoeuvre: Manoeuvre, seed: int) -> None:
    watcher = Watcher(follow())
    assert watch(messages(driven(manoeuvre, {}, 300.0, seed).recording), watcher) == []
    assert "as at the start" in watcher.status()


def test_three_times_the_noise_brings_no_sentence_either() -> None:
    noise = replace(REALISTIC, torque=0.9, slip=0.009, gyro=0.015, position=0.015, heading=math.radians(0.9))
    ride = drive(packets(errands(120.0, 3), 120.0), {}, 120.0, noise, 1)
    assert watch(messages(ride.recording)) == []


@pytest.mark.parametrize("effect", ["coulomb_friction", "lateral_skid", "pose_latency", "turn_slip"])
def test_what_the_parameters_lack_from_the_start_is_no_change(effect: str) -> None:
    values = {parameter.name: float(parameter.typical or 0.0) for parameter in CATALOGUE[effect].parameters}
    assert watch(messages(driven(errands(120.0, 2), values, 120.0).recording)) == []


@pytest.mark.parametrize("seed", [1, *further(2, 3)])
def test_another_floor_is_named(seed: int) -> None:
    floor = {"surface_change_k1": 0.05, "surface_change_base_width": 0.05, "surface_change_time": CHANGE}
    said = watch(messages(driven(eight(END), floor, seed=seed).recording))
    sentence = only(said, "Robot 0: ", "slower", "turns", "less", "another floor (effect surface_change)")
    assert told_per_cent(sentence) == pytest.approx(4.8, abs=1.5)


@pytest.mark.parametrize("seed", [1, *further(2, 3)])
def test_a_heavier_load_is_named(seed: int) -> None:
    load = {"payload_change_share": 0.25, "payload_change_time": CHANGE}
    steps = in_turn([(25.0, reversals(0.5))] * 4)
    said = watch(messages(driven(steps, load, seed=seed).recording))
    assert "Suspected: a heavier load" in only(said, "longer to follow", "(effect payload_change)")


@pytest.mark.parametrize("seed", [1, *further(2)])
def test_a_battery_that_runs_down_is_named_with_its_voltage_and_said_again_when_it_has_gone_on(seed: int) -> None:
    ride = driven(eight(150.0), {"battery_drift": 0.08}, 150.0, seed)
    said = watch(messages(ride.recording, voltage=lambda time: 12.4 - 0.01 * time))
    assert all("a low battery (effect battery_drift). Charge" in sentence for _, sentence in said)
    assert "12.4 V at the start" in said[0][1] or "12.3 V at the start" in said[0][1]
    assert len(said) == 2
    assert said[1][0] - said[0][0] >= 60.0


def test_slower_wheels_are_not_blamed_on_a_battery_whose_voltage_stays() -> None:
    ride = driven(eight(END), {"surface_change_k1": 0.08, "surface_change_time": CHANGE})
    said = watch(messages(ride.recording, voltage=lambda _time: 12.4))
    assert "not the battery" in only(said, "7 % slower")


def test_what_has_been_said_stays_visible_once_and_is_not_news_again() -> None:
    falling = messages(undisturbed(1).recording, voltage=lambda time: 12.4 - 0.15 * max(time - CHANGE, 0.0))
    watcher, said, shown = Watcher(follow()), [], [""]
    for message in falling:
        said += handled(watcher, *message)
        shown += [watcher.status()] if watcher.status() != shown[-1] else []
    assert len(said) == 1
    assert "Charge the battery" in said[0]
    assert shown[-1] == said[0] == watcher.alarms
    assert [text for text in shown if "Charge the battery" in text] == said


def test_a_voltage_that_falls_is_enough() -> None:
    heard = messages(undisturbed(1).recording, voltage=lambda time: 12.4 if time < CHANGE else 10.9)
    assert "Charge the battery" in only(watch(heard), "10.9 V, 12.4 V at the start")


@pytest.mark.parametrize("seed", [1, *further(2)])
@pytest.mark.parametrize(
    ("left", "right", "cause"),
    [
        (0.5, 0.0, "the left wheel slips"),
        (0.0, 0.25, "the right wheel slips"),
        (0.4, 0.4, "both wheels slip"),
        (1.0, 1.0, "the robot is blocked"),
    ],
)
def test_slip_is_named_with_its_side_and_size(left: float, right: float, cause: str, seed: int) -> None:
    said = watch(messages(slipping(undisturbed(seed), left, right)))
    sentence = only(said, f"Suspected: {cause}")
    assert told_per_cent(sentence) == pytest.approx(100.0 * max(left, right), abs=4.0)


@pytest.mark.parametrize("missing", ["gyro", "poses"])
def test_a_slipping_wheel_is_seen_without_gyro_and_without_poses(missing: str) -> None:
    said = watch(messages(without(slipping(undisturbed(1), 0.5, 0.0), missing)))
    assert "Suspected: the left wheel slips" in only(said)


def test_slip_that_ends_is_said_to_be_over_and_the_next_is_seen_again() -> None:
    watcher = Watcher(follow())
    ride = driven(eight(175.0), {}, 175.0)
    said = watch(messages(slipping(ride, 0.5, 0.0, seconds=15.0, period=80.0)), watcher)
    sentences = [sentence for _, sentence in said]
    assert ["slips. Check" in sentence for sentence in sentences] == [True, False, True, False]
    assert sentences[1] == "Robot 0: No longer: the left wheel slips. Everything is as at the start again."
    assert "as at the start" in watcher.status()


def test_a_suspicion_that_comes_and_goes_is_not_said_more_than_once_a_minute() -> None:
    ride = driven(eight(200.0), {}, 200.0)
    said = watch(messages(slipping(ride, 0.5, 0.0, seconds=8.0, period=20.0)))
    times = [time for time, sentence in said if "slips. Check" in sentence]
    assert 1 <= len(times) <= 3
    assert all(later - earlier >= 60.0 for earlier, later in pairwise(times))
    assert len(said) <= 2 * len(times)


@pytest.mark.parametrize("seed", [1, *further(2)])
def test_a_gyro_whose_zero_moves_is_at_fault_and_not_the_robot(seed: int) -> None:
    recording = edited(undisturbed(seed).recording, "gyro", yaw_rate=lambda since, rate: rate + 0.02 * (since > 0.0))
    assert "the gyro's zero has drifted; the robot is unchanged" in only(
        watch(messages(recording)), "Robot 0: The gyro"
    )


def test_a_gyro_whose_zero_moves_is_seen_at_rest() -> None:
    still = driven(constant(0.0, 0.0), {})
    recording = edited(still.recording, "gyro", yaw_rate=lambda since, rate: rate + 0.01 * (since > 0.0))
    assert "gyro reads 0.010 rad/s more" in only(watch(messages(recording)), "gyro_bias")


def test_a_gyro_that_stops_telling_turns_is_at_fault() -> None:
    recording = edited(undisturbed(1).recording, "gyro", yaw_rate=gone)
    assert "the gyro no longer measures turns" in only(watch(messages(recording)))


def test_frozen_poses_are_the_localisations_fault_until_they_move_again() -> None:
    thaw = 15.0

    def frozen(since: Floats, values: Floats) -> Floats:
        return np.where(since < thaw, held(since, values), values)

    recording = edited(undisturbed(1).recording, "poses", x=frozen, y=frozen, theta=frozen)
    said = watch(messages(recording))
    assert (
        "The poses stay exactly the same while the wheels turn: the localisation is at fault, not the robot"
        in said[0][1]
    )
    assert all(
        "robot" not in sentence.replace("Robot 0", "").replace("not the robot", "") or "see" in sentence
        for _, sentence in said
    )
    assert "No longer: frozen poses" in said[-1][1]


def test_a_pose_that_jumps_is_the_localisations_fault() -> None:
    recording = edited(undisturbed(1).recording, "poses", x=lambda since, x: x + 0.4 * (since > 0.0))
    sentence = only(watch(messages(recording)), "The pose jumped by 0.4", before=CHANGE + 4.0)
    assert "not the robot" in sentence


@pytest.mark.parametrize("seed", [1, *further(2)])
def test_poses_that_come_to_be_stamped_late_are_the_localisations_fault(seed: int) -> None:
    late = 0.3

    def delayed(since: Floats, values: Floats) -> Floats:
        return np.where(since > 0.0, np.interp(since - late, since, np.unwrap(values)), values)

    steps = in_turn([(25.0, reversals(0.3))] * 4)
    recording = driven(steps, {}, seed=seed).recording
    said = watch(messages(edited(recording, "poses", x=delayed, y=delayed, theta=delayed)))
    assert any("the localisation is late" in sentence for _, sentence in said)
    assert all("localisation" in sentence for _, sentence in said)


@pytest.mark.parametrize(("signal", "name"), [("poses", "poses"), ("gyro", "gyro readings")])
def test_a_robot_whose_sensor_ends_is_not_blamed(signal: str, name: str) -> None:
    said = watch(messages(without(undisturbed(1).recording, signal, since=CHANGE)))
    sentence = only(said, f"no usable {name}", before=CHANGE + 6.0)
    assert "the sensor or its process has stopped" in sentence


@pytest.mark.parametrize(
    ("status", "why"),
    [
        (0, "the motor is off or blocked"),
        (motor_feedback_t.STATUS_ESTOP, "the emergency stop is engaged; release it"),
        (motor_feedback_t.STATUS_NOT_ARMED, "the motors are not armed"),
    ],
)
def test_wheels_that_stand_still_against_their_commands_are_told_with_the_reason_known(status: int, why: str) -> None:
    said = watch(messages(halted(), status=status))
    assert why in only(said, "Both sides' wheels stand still", before=CHANGE + 6.0)


def test_one_side_that_stands_still_is_told_apart() -> None:
    assert "The left wheels stand still" in watch(messages(halted(right=False)))[0][1]


def test_encoders_that_stop_are_told_from_wheels_that_stop() -> None:
    recording = edited(undisturbed(1).recording, "wheels", psi_left=gone, psi_right=gone)
    assert "the robot moves, so the encoder is at fault" in only(watch(messages(recording)))


def test_new_parameters_are_said_once_and_begin_anew() -> None:
    k1 = 0.1
    other = ParameterFile(0, {**TRUE.values, "k1": Value(NEUTRAL.k1 * (1.0 + k1))})
    ride = driven(eight(175.0), {"surface_change_k1": k1, "surface_change_time": CHANGE}, 175.0)
    heard = messages(ride.recording)
    calibrated = START_UTIME + 100_000_000
    announced = [(calibrated + k * 1_000_000, PARAMETERS.channel(0), other.announcement(2)) for k in range(50)]
    watcher = Watcher(follow())
    said = watch(sorted(heard + announced, key=lambda message: message[0]), watcher)
    assert "slower" in said[0][1]
    assert [sentence for _, sentence in said[1:]] == ["Robot 0: The parameters have changed: monitoring starts again."]
    assert "as at the start" in watcher.status()


def test_a_robot_with_effects_is_watched_by_them() -> None:
    friction = {"coulomb_friction": 4.0, "surface_change_base_width": 0.08, "surface_change_time": CHANGE}
    file = ParameterFile(0, {**TRUE.values, "coulomb_friction": Value(4.0)}, ("coulomb_friction",))
    said = watch(messages(driven(eight(END), friction).recording), Watcher(follow(file)))
    assert told_per_cent(only(said, "turns", "less")) == pytest.approx(7.4, abs=1.5)


def test_a_log_gives_the_same_sentences_at_any_speed_and_with_messages_that_come_late() -> None:
    heard = messages(slipping(undisturbed(2), 0.5, 0.0, seconds=10.0))
    expected = [sentence for _, sentence in watch(heard)]
    assert len(expected) == 2
    for every in (10_000, 10**9):
        assert [sentence for _, sentence in watch(heard, every=every)] == expected
    lateness = {POSE.channel(0): 400_000, GYRO.channel(0): 150_000}
    late = sorted(heard, key=lambda message: message[0] + lateness.get(message[1], 0))
    assert [sentence for _, sentence in watch(late)] == expected


def test_a_wrong_time_stamp_does_not_end_the_watch() -> None:
    heard = messages(slipping(undisturbed(1), 0.5, 0.0))
    wrong = [index for index, message in enumerate(heard) if message[1] == MOTOR_FEEDBACK.channel(0)][3000]
    heard[wrong] = (heard[wrong][0] + 10**12, *heard[wrong][1:])
    watcher = Watcher(follow())
    said = [sentence for utime, channel, message in heard for sentence in handled(watcher, utime, channel, message)]
    assert len(said) == 1
    assert "the left wheel slips" in said[0]


def size_of(thing: Any) -> int:
    """The bytes of everything that hangs on a thing; what all programs share is left out."""
    seen: set[int] = set()
    total, found = 0, [thing]
    while found:
        item = found.pop()
        if id(item) in seen or isinstance(item, type | ModuleType | FunctionType):
            continue
        seen.add(id(item))
        total += sys.getsizeof(item)
        found += gc.get_referents(item)
    return total


def test_memory_does_not_grow_with_time() -> None:
    watcher, sizes = Watcher(follow()), []
    rare = [message for message in messages(undisturbed(1).recording) if message[0] % 100_000 == 0]
    for repetition in range(8):
        for utime, channel, message in rare:
            handled(watcher, utime + repetition * round(END * 1e6), channel, message)
        sizes.append(size_of(watcher))
    assert sizes[0] > 10_000
    assert sizes[-1] < sizes[2] + 10_000


def test_robots_are_told_apart_and_one_can_be_chosen() -> None:
    slips, drives = messages(slipping(undisturbed(1), 0.5, 0.0), 3), messages(undisturbed(2).recording, 4)
    both = sorted(slips + drives, key=lambda message: message[0])
    only(watch(both), "Robot 3: ")
    only(watch(both, Watcher(follow(), 3)), "Robot 3: ")
    watcher = Watcher(follow(), 4)
    assert watch(both, watcher) == []
    assert watcher.status().startswith("Robot 4: watching wheels, gyro, poses")


def test_without_a_robot_or_its_parameters_it_says_what_it_waits_for() -> None:
    watcher = Watcher(follow(None))
    assert watcher.status() == "Waiting for a robot: nothing received on MOTOR_FEEDBACK_N."
    heard = messages(undisturbed(1).recording)
    assert watch(heard[:2000], watcher) == []
    assert "none are announced on PARAMETERS_0" in watcher.status()
    assert watcher.problem
    incomplete = ParameterFile(0, {"wheel_radius": Value(0.04)}).announcement(1)
    watcher.handle(incomplete.utime, PARAMETERS.channel(0), incomplete)
    assert "incomplete" in watcher.problem
    announced = TRUE.announcement(2)
    watcher.handle(announced.utime, PARAMETERS.channel(0), announced)
    assert watch(heard[2000:], watcher) == []
    assert not watcher.problem
    assert watcher.parameters_sha256 == announced.sha256


def test_it_tells_that_it_learns_and_that_a_robot_has_fallen_silent() -> None:
    watcher = Watcher(follow())
    heard = messages(undisturbed(1).recording)
    watch(heard[:3000], watcher)
    assert "learning how it moves" in watcher.status()
    watcher.advance(heard[3000][0] + 12_000_000)
    assert "no motor feedback for 12 s" in watcher.status()


def test_every_cause_names_an_effect_of_the_catalogue_or_none() -> None:
    assert {cause.effect for cause in CAUSES} - {""} <= CATALOGUE.keys()


def test_the_mbots_drive_of_three_minutes_brings_no_sentence(tmp_path: Path) -> None:
    if not DATA.is_dir():
        pytest.skip(f"measured data is not here: {DATA}")
    recording = Importer(DATA, tmp_path).read("mbot", DATA / "mbot_square/drive_square.log")
    assert recording.parameters is not None
    assert watch(messages(recording), Watcher(follow(recording.parameters))) == []
