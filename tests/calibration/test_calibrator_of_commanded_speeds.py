"""A calibration during the drive of a robot with a velocity controller tells what it finds in that robot's words."""

from typing import Any

import pytest

from cmr.bus.streams import GYRO, MOTOR_FEEDBACK
from cmr.calibration.calibrator import Calibrator
from cmr.msg import calibration_status_t
from cmr.recordings.recording import Recorder
from robot_driver.emulator.settings import load_settings
from tests.support.emulated_speed_robot import messages_of, nominal_of

pytestmark = pytest.mark.slow

IDEAL = load_settings(ideal=True)
NOMINAL = nominal_of(IDEAL, base_width=0.2, response_time=0.25)
Messages = list[tuple[str, Any]]


@pytest.fixture(scope="module")
def drive() -> Messages:
    return messages_of(IDEAL)


def heard(messages: Messages) -> Calibrator:
    calibrator = Calibrator(0, NOMINAL)
    for channel, message in messages:
        calibrator.handle(message.utime, channel, message)
    return calibrator


def from_log(messages: Messages) -> Calibrator:
    recorder = Recorder(0)
    for channel, message in messages:
        recorder.handle(message.utime, channel, message)
    return Calibrator.of(recorder.messages(), NOMINAL)


def test_what_is_known_so_far_is_told_in_the_words_of_the_robots_file(drive: Messages) -> None:
    calibrator = heard(drive[: len(drive) // 2])
    assert calibrator.state == calibration_status_t.COLLECTING
    calibrator.look(calibrator.recording())
    assert {"response_time", "speed_scale", "base_width"} == set(calibrator.so_far)
    assert calibrator.so_far["response_time"].value == pytest.approx(IDEAL.velocity_controller.response_time, rel=0.02)


def test_without_wheels_the_commanded_velocities_tell_when_the_drive_is_over(drive: Messages) -> None:
    sensors = {stream.channel(0) for stream in (MOTOR_FEEDBACK, GYRO)}
    commands_and_poses = [(channel, message) for channel, message in drive if channel not in sensors]
    live, log = heard(commands_and_poses), from_log(commands_and_poses)
    assert live.complete
    assert not live.missing
    assert log.complete
    assert log.recording().poses.utime.tolist() == live.recording().poses.utime.tolist()
