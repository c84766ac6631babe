"""The live watch of a robot with a velocity controller goes by the speeds that it was told."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from cmr.bus.streams import GYRO, MOTOR_FEEDBACK, VELOCITY_COMMAND
from cmr.diagnosis.live import Watcher
from robot_driver.emulator.settings import load_settings
from tests.diagnosis.watched_drive import CHANGE, Message, follow, watch
from tests.support.emulated_speed_robot import BEGINNING, messages_of, nominal_of

pytestmark = pytest.mark.slow

SETTINGS = load_settings()  # with imperfections
KNOWN = nominal_of(SETTINGS)
WEAKER = 0.1
Edit = Callable[[Any], None]


@pytest.fixture(scope="module")
def drive() -> list[Message]:
    return [(message.utime, channel, message) for channel, message in messages_of(SETTINGS, manoeuvre="rich_drive")]


def said(drive: list[Message], channel: str = "", edit: Edit | None = None) -> tuple[list[str], Watcher]:
    """What a watcher says, and the watcher, where messages of a channel are edited from CHANGE on."""
    watcher = Watcher(follow(replace(KNOWN, robot_id=0)))
    changed = []
    for utime, own, message in drive:
        if edit and own == channel and utime > BEGINNING + CHANGE * 1e6:
            message = _copy(message)
            edit(message)
        changed.append((utime, own, message))
    return [sentence for _, sentence in watch(changed, watcher)], watcher


def _copy(message: Any) -> Any:
    return type(message).decode(message.encode())


def test_nothing_is_said_of_a_robot_that_follows_as_at_the_start(drive: list[Message]) -> None:
    sentences, watcher = said(drive)
    assert sentences == []
    assert "as at the start" in watcher.status()


def test_wheels_that_stand_are_told_with_the_speed_that_was_commanded(drive: list[Message]) -> None:
    def stand(message: Any) -> None:
        message.psi_left = message.psi_right = 0.0

    sentences, _ = said(drive, MOTOR_FEEDBACK.channel(0), stand)
    assert any("stand still at a commanded speed of" in one and "rad/s" in one for one in sentences)
    assert not any("duty" in one for one in sentences)


def test_a_robot_that_is_slower_for_the_same_commands_is_held_back_by_its_controller(drive: list[Message]) -> None:
    def ask_for_more(message: Any) -> None:
        message.v /= 1.0 - WEAKER
        message.omega /= 1.0 - WEAKER

    sentences, _ = said(drive, VELOCITY_COMMAND.channel(0), ask_for_more)
    assert len(sentences) == 1
    assert "own controller holds back both sides' wheels" in sentences[0]
    assert "effect" not in sentences[0]  # none of the catalogue's shows with speeds


def test_a_gyro_whose_zero_drifts_is_named_as_on_any_robot(drive: list[Message]) -> None:
    def drift(message: Any) -> None:
        message.yaw_rate += 0.03

    sentences, _ = said(drive, GYRO.channel(0), drift)
    assert len(sentences) == 1
    assert "the gyro's zero has drifted" in sentences[0]
