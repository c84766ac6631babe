"""Only the newest fresh, sane command moves the motors."""

import math

import pytest

from cmr.msg import motor_feedback_t
from robot_driver.command_gate import CommandGate, Drive

STALE, ESTOP = motor_feedback_t.STATUS_COMMAND_STALE, motor_feedback_t.STATUS_ESTOP
ZERO = Drive(0.0, 0.0, STALE)


def test_without_a_command_nothing_moves() -> None:
    assert CommandGate().drive(1000.0) == ZERO


def test_a_command_drives_for_half_a_second_and_no_longer() -> None:
    gate = CommandGate()
    gate.offer(1, 0.5, -0.25, 10.0)
    assert gate.drive(10.0) == Drive(0.5, -0.25, 0)
    assert gate.drive(10.499) == Drive(0.5, -0.25, 0)
    assert gate.drive(10.501) == ZERO


@pytest.mark.parametrize(
    ("left", "right", "reason"),
    [
        (math.nan, 0.0, "not_finite"),
        (0.0, math.inf, "not_finite"),
        (-math.inf, math.nan, "not_finite"),
        (1.0001, 0.0, "out_of_range"),
        (0.0, -7.0, "out_of_range"),
    ],
)
def test_an_insane_command_moves_nothing_and_is_counted(left: float, right: float, reason: str) -> None:
    gate = CommandGate()
    gate.offer(1, left, right, 10.0)
    assert gate.drive(10.0) == ZERO
    assert gate.rejected == {reason: 1}


def test_an_insane_command_does_not_prolong_the_one_in_force() -> None:
    gate = CommandGate()
    gate.offer(1, 0.5, 0.5, 10.0)
    gate.offer(2, math.nan, 0.5, 10.4)
    assert gate.drive(10.4) == Drive(0.5, 0.5, 0)
    assert gate.drive(10.6) == ZERO


def test_old_and_replayed_commands_are_not_taken() -> None:
    gate = CommandGate()
    gate.offer(100, 0.1, 0.1, 10.0)
    gate.offer(99, 0.9, 0.9, 10.1)
    gate.offer(100, 0.9, 0.9, 10.1)
    assert gate.drive(10.2) == Drive(0.1, 0.1, 0)
    gate.offer(99, 0.9, 0.9, 20.0)
    assert gate.drive(20.0) == ZERO
    assert gate.rejected == {"old": 3}


def test_estop_holds_until_released_and_then_waits_for_a_new_command() -> None:
    gate = CommandGate()
    gate.offer(1, 0.5, 0.5, 10.0)
    gate.set_estop(True)
    assert gate.drive(10.1) == Drive(0.0, 0.0, ESTOP | STALE)
    gate.offer(2, 0.5, 0.5, 10.2)
    assert gate.drive(10.2) == Drive(0.0, 0.0, ESTOP)
    gate.set_estop(True)
    gate.set_estop(False)
    assert gate.drive(10.2) == ZERO
    gate.offer(3, 0.5, 0.5, 10.3)
    assert gate.drive(10.3) == Drive(0.5, 0.5, 0)


def test_after_a_new_connection_a_new_command_is_needed() -> None:
    gate = CommandGate()
    gate.offer(1, 0.5, 0.5, 10.0)
    gate.clear()
    assert gate.drive(10.0) == ZERO


def test_commands_that_waited_while_the_process_was_held_up_move_nothing() -> None:
    gate = CommandGate()
    gate.offer(1, 0.5, 0.5, 10.0)
    gate.note_held_up(14.0)
    gate.offer(2, 0.5, 0.5, 14.0)
    assert gate.drive(14.0) == ZERO
    assert gate.rejected == {"held_up": 1}
    gate.offer(3, 0.4, 0.4, 14.2)
    assert gate.drive(14.2) == Drive(0.4, 0.4, 0)
