"""Emulated robots that somebody has wired wrongly are brought up: settings are right, or left open with the reason."""

import dataclasses
from pathlib import Path

import pytest

from cmr.parameters.file import load as load_parameters
from robot_driver.emulator.settings import load_settings
from robot_driver.simulated.bringing_up import Person, SimulatedBringup
from tests.robot_driver.bringup.robots import robot, verdict
from tests.support.lanes import further

pytestmark = pytest.mark.slow

CASES = [
    robot(),
    robot("mirrored", flags=("motors", "left"), gyro=-1.0),
    robot("rotated", flags=("motors", "encoders", "right"), gyro=0.5),
    robot("y up", flags=("left", "right"), gyro=0.0),
    robot("mm", flags=("encoders",), stated=1024),
    robot("degrees", flags=("motors", "left", "right", "encoders"), stated=512, controller="roboteq"),
    robot("late", flags=("left_against",), stated=0),
    robot("offset", flags=("right_against", "right"), stated=4096, controller="mbot"),
    robot("other body", flags=("motors",), controller="mbot"),
    robot("swapped", flags=("right",), gyro=-1.0, controller="roboteq"),
    robot(flags=("left_dead", "motors", "encoders")),
    robot("mirrored", "mm", "late", flags=("right_dead",), gyro=0.0),
    robot("rotated", "degrees", "offset", held=0.15),
]


@pytest.mark.parametrize("number", range(len(CASES)))
def test_what_is_wrong_is_found_and_nothing_wrong_is_written(number: int, tmp_path: Path) -> None:
    case = CASES[number]
    outcome = case.bringup.run_directly(tmp_path)
    assert verdict(case, outcome)[0] == "right", outcome.text
    assert outcome.largest_before_yes <= 0.1
    assert outcome.largest_before_floor <= 0.2


WHOLE = [
    robot("mirrored", flags=("motors", "left"), gyro=-1.0, stop=True),
    robot("mm", flags=("right", "encoders"), stated=1024, controller="roboteq"),
    robot("late", flags=("motors",), controller="mbot"),
]


@pytest.mark.parametrize("number", [*further(0), 1, *further(2)])
def test_the_same_through_the_driver_and_the_bytes_of_each_controller(number: int, tmp_path: Path) -> None:
    """Ports are found by asking, the last gate watches; with the cable pulled the stop is measured."""
    case = WHOLE[number]
    outcome = case.bringup.run(tmp_path)
    assert verdict(case, outcome)[0] == "right", outcome.text
    assert outcome.known.driver["controller"] == case.bringup.controller
    assert outcome.largest_before_yes <= 0.1
    if case.bringup.person.measures_stop:
        assert 0.4 < outcome.known.number("stop_time") < 1.2
    file = load_parameters(tmp_path / "robot_0.yaml")
    assert file.value("wheel_radius") == pytest.approx(0.04)
    assert file.value("k1") == pytest.approx(0.054, rel=0.1)
    assert file.value("k2_over_k3") == pytest.approx(118.0, rel=0.3)


def test_a_motor_that_is_held_gets_no_more_without_a_yes(tmp_path: Path) -> None:
    case = robot(held=0.15)
    person = dataclasses.replace(case.bringup.person, allows_more=False)
    outcome = dataclasses.replace(case.bringup, person=person).run_directly(tmp_path)
    assert "more was not allowed" in outcome.of("motors").text
    assert outcome.largest_before_floor <= 0.1
    assert outcome.known.undecided[0] == "motors"


def test_a_motor_that_never_turns_gets_20_percent_at_most(tmp_path: Path) -> None:
    outcome = robot(held=0.5).bringup.run_directly(tmp_path)
    assert "turned nothing at 20% duty" in outcome.of("motors").text
    assert 0.19 < outcome.largest_before_floor <= 0.2


def test_one_step_can_be_run_again(tmp_path: Path) -> None:
    """The gyro is turned over afterwards; all else stays as it was."""
    case = robot()
    before = case.bringup.run_directly(tmp_path).known
    before = dataclasses.replace(before, driver=dict(before.driver))
    turned = dataclasses.replace(case.settings, mounting=dataclasses.replace(case.settings.mounting, gyro_factor=-1.0))
    after = dataclasses.replace(case.bringup, settings=turned).run_directly(tmp_path, ("gyro",), before).known
    assert after.driver == before.driver | {"invert_gyro": True}
    assert "gyro: " in (tmp_path / "robot_0_driver.yaml").read_text()


def test_a_person_who_miscounts_every_time_has_nothing_written(tmp_path: Path) -> None:
    settings = load_settings(seed=5)
    person = Person(0.04, 0.161, 2048, miscounts=1.0, measures_stop=False)
    outcome = SimulatedBringup(settings, person, seed=4).run_directly(tmp_path)
    assert outcome.known.driver.get("ticks_per_turn") in (None, 2048)
