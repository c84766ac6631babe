"""Only the newest fresh, sane command moves the motors."""

import math

import pytest

from cmr.msg import motor_feedback_t
from robot_driver.command_gate import CommandGate, Drive, Stop

STALE, ESTOP = motor_feedback_t.STATUS_COMMAND_STALE, motor_feedback_t.STATUS_ESTOP
ZERO = Drive(0.0, 0.0, STALE)
EPOCH = 1_700_000_000_000_000  # us


class Gate(CommandGate):
    """A gate whose clocks begin together: at `now` it is EPOCH + now, and commands arrive when they are decided.

    It was opened long ago.
    """

    def __init__(self) -> None:
        super().__init__()
        self.note_listening(0.0)
        self.command(1.0, 0.0, 0.0)

    def command(self, now: float, left: float, right: float, *, age: float = 0.0) -> None:
        self.offer(utime_at(now - age), left, right, now=now, utime=utime_at(now))

    def estop(self, now: float, engaged: bool, *, age: float = 0.0) -> None:
        self.take_estop(engaged, utime_at(now - age), utime=utime_at(now))


def utime_at(now: float) -> int:
    return EPOCH + round(now * 1e6)


def test_until_an_emergency_stop_would_have_been_heard_nothing_but_zero_is_taken() -> None:
    gate = CommandGate()

    def offer(now: float, duty: float) -> Drive:
        gate.offer(utime_at(now), duty, duty, now=now, utime=utime_at(now))
        return gate.drive(now)

    assert offer(10.0, 0.5) == ZERO
    gate.note_listening(11.0)
    assert offer(11.0, 0.0) == Drive(0.0, 0.0, 0)
    assert offer(11.39, 0.5) == Drive(0.0, 0.0, 0)
    assert gate.rejected == {"starting": 2}
    assert offer(11.41, 0.5) == Drive(0.5, 0.5, 0)


def test_who_commands_from_the_start_on_is_obeyed_once_no_emergency_stop_was_heard() -> None:
    gate = CommandGate()
    gate.note_listening(10.0)
    gate.offer(utime_at(11.0), 0.5, 0.5, now=11.0, utime=utime_at(11.0))
    assert gate.drive(11.0) == Drive(0.5, 0.5, 0)


def test_after_a_stop_that_was_heard_at_the_start_zero_must_be_commanded_first() -> None:
    gate = CommandGate()
    gate.note_listening(10.0)
    gate.take_estop(True, utime_at(10.1), utime=utime_at(10.1))
    gate.take_estop(False, utime_at(10.9), utime=utime_at(10.9))
    gate.offer(utime_at(11.0), 0.5, 0.5, now=11.0, utime=utime_at(11.0))
    assert gate.drive(11.0) == ZERO
    assert gate.rejected == {"not_zero": 1}
    assert gate.needs_zero
    gate.offer(utime_at(11.1), 0.0, 0.0, now=11.1, utime=utime_at(11.1))
    assert not gate.needs_zero


def test_without_a_command_nothing_moves() -> None:
    assert Gate().drive(1000.0) == ZERO


def test_a_command_drives_for_half_a_second_and_no_longer() -> None:
    gate = Gate()
    gate.command(10.0, 0.5, -0.25)
    assert gate.drive(10.0) == Drive(0.5, -0.25, 0)
    assert gate.drive(10.499) == Drive(0.5, -0.25, 0)
    assert gate.drive(10.501) == ZERO


def test_the_half_second_begins_when_the_command_was_decided() -> None:
    gate = Gate()
    gate.command(10.0, 0.5, 0.5, age=0.3)
    assert gate.drive(10.19) == Drive(0.5, 0.5, 0)
    assert gate.drive(10.21) == ZERO


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
    gate = Gate()
    gate.command(10.0, left, right)
    assert gate.drive(10.0) == ZERO
    assert gate.rejected == {reason: 1}


def test_an_insane_command_does_not_prolong_the_one_in_force() -> None:
    gate = Gate()
    gate.command(10.0, 0.5, 0.5)
    gate.command(10.4, math.nan, 0.5)
    assert gate.drive(10.4) == Drive(0.5, 0.5, 0)
    assert gate.drive(10.6) == ZERO


def test_commands_out_of_order_and_twice_the_same_are_not_taken() -> None:
    gate = Gate()
    gate.command(10.0, 0.1, 0.1)
    gate.command(10.1, 0.9, 0.9, age=0.11)
    gate.command(10.1, 0.9, 0.9, age=0.1)
    assert gate.drive(10.2) == Drive(0.1, 0.1, 0)
    assert gate.rejected == {"old": 2}


@pytest.mark.parametrize(("age", "reason"), [(0.51, "old"), (30 * 86400.0, "old"), (-0.51, "future")])
def test_the_first_command_of_a_replayed_log_or_of_a_wrong_clock_moves_nothing(age: float, reason: str) -> None:
    gate = Gate()
    gate.command(10.0, 0.5, 0.5, age=age)
    assert gate.drive(10.0) == ZERO
    assert gate.rejected == {reason: 1}
    gate.command(10.1, 0.2, 0.2)
    assert gate.drive(10.1) == Drive(0.2, 0.2, 0)


def test_estop_holds_until_released_and_then_zero_must_be_commanded_first() -> None:
    gate = Gate()
    gate.command(10.0, 0.5, 0.5)
    gate.estop(10.1, True)
    assert gate.drive(10.1) == Drive(0.0, 0.0, ESTOP | STALE)
    gate.command(10.2, 0.5, 0.5)
    assert gate.drive(10.2) == Drive(0.0, 0.0, ESTOP)
    gate.estop(10.25, True)
    gate.estop(10.3, False)
    assert gate.drive(10.3) == ZERO
    gate.command(10.4, 0.5, 0.5)
    assert gate.drive(10.4) == ZERO
    assert gate.rejected == {"not_zero": 1}
    gate.command(10.5, 0.0, 0.0)
    gate.command(10.6, 0.5, 0.5)
    assert gate.drive(10.6) == Drive(0.5, 0.5, 0)


@pytest.mark.parametrize("stop", [Stop.BUS, Stop.CONTROLLER])
def test_zero_commanded_before_the_release_does_not_count(stop: Stop) -> None:
    gate = Gate()
    gate.hold(stop)
    gate.command(10.0, 0.0, 0.0)
    gate.release(stop)
    gate.command(10.1, 0.5, 0.5)
    assert gate.drive(10.1) == ZERO
    assert gate.rejected == {"not_zero": 1}
    gate.command(10.2, 0.0, 0.0)
    gate.command(10.3, 0.5, 0.5)
    assert gate.drive(10.3) == Drive(0.5, 0.5, 0)


def test_zero_that_was_decided_before_the_release_but_comes_later_does_not_count() -> None:
    gate = Gate()
    gate.estop(10.0, True)
    gate.estop(10.3, False)
    gate.command(10.31, 0.0, 0.0, age=0.1)
    gate.command(10.32, 0.5, 0.5)
    assert gate.drive(10.32) == Drive(0.0, 0.0, 0)
    assert gate.rejected == {"not_zero": 1}
    gate.command(10.4, 0.0, 0.0)
    gate.command(10.5, 0.5, 0.5)
    assert gate.drive(10.5) == Drive(0.5, 0.5, 0)


def test_when_the_time_of_day_is_set_back_commands_go_on_being_taken() -> None:
    gate = Gate()
    gate.command(10.0, 0.5, 0.5)
    an_hour_earlier = utime_at(10.1) - 3_600_000_000
    gate.offer(an_hour_earlier, 0.25, 0.25, now=10.1, utime=an_hour_earlier)
    assert gate.drive(10.1) == Drive(0.25, 0.25, 0)
    gate.offer(an_hour_earlier, 0.5, 0.5, now=10.2, utime=an_hour_earlier + 100_000)
    assert gate.rejected == {"old": 1}


def test_when_the_time_of_day_is_set_back_an_emergency_stop_can_be_released() -> None:
    gate = Gate()
    gate.estop(10.0, True)
    gate.estop(10.1, False)
    gate.estop(10.2, True)
    earlier = utime_at(10.3) - 3_600_000_000
    gate.take_estop(False, earlier, utime=earlier)
    for after, duty in enumerate((0.0, 0.5), start=1):
        gate.offer(earlier + after, duty, duty, now=10.3, utime=earlier + after)
    assert gate.drive(10.3) == Drive(0.5, 0.5, 0)


def test_after_an_emergency_stop_during_which_nobody_commanded_zero_must_be_commanded_first() -> None:
    gate = Gate()
    gate.command(10.0, 0.5, 0.5)
    gate.estop(10.1, True)
    gate.estop(10.2, False)
    gate.command(10.3, 0.5, 0.5)
    assert gate.drive(10.3) == ZERO
    assert gate.rejected == {"not_zero": 1}


@pytest.mark.parametrize(("engaged_ago", "released_ago"), [(0.1, 0.2), (5.0, 0.6), (0.0, -0.6)])
def test_a_release_that_is_old_or_replayed_does_not_release(engaged_ago: float, released_ago: float) -> None:
    gate = Gate()
    gate.estop(10.0, True, age=engaged_ago)
    gate.estop(10.0, False, age=released_ago)
    assert gate.drive(10.0).status & ESTOP
    assert gate.releases_rejected == 1


def test_with_two_stops_both_must_be_released() -> None:
    gate = Gate()
    gate.estop(10.0, True)
    gate.hold(Stop.CONTROLLER)
    gate.estop(10.1, False)
    gate.command(10.2, 0.0, 0.0)
    gate.command(10.3, 0.5, 0.5)
    assert gate.drive(10.3) == Drive(0.0, 0.0, ESTOP)
    gate.release(Stop.CONTROLLER)
    gate.command(10.5, 0.5, 0.5)
    assert gate.drive(10.5) == ZERO


def test_after_a_new_connection_a_new_command_is_needed() -> None:
    gate = Gate()
    gate.command(10.0, 0.5, 0.5)
    gate.clear()
    assert gate.drive(10.0) == ZERO


def test_commands_that_waited_while_the_process_was_held_up_move_nothing() -> None:
    gate = Gate()
    gate.command(10.0, 0.5, 0.5)
    gate.note_held_up(14.0)
    gate.command(14.0, 0.5, 0.5)
    assert gate.drive(14.0) == ZERO
    assert gate.rejected == {"held_up": 1}
    gate.command(14.2, 0.4, 0.4)
    assert gate.drive(14.2) == Drive(0.4, 0.4, 0)


@pytest.mark.parametrize(
    ("left", "age", "why"),
    [
        (math.nan, 0.0, "not_finite"),
        (-math.inf, 0.0, "not_finite"),
        (1e300, 0.0, "out_of_range"),
        (500.0, 0.0, "out_of_range"),
        (0.5, -3600.0, "future"),
        (0.5, 3600.0, "old"),
    ],
)
def test_a_command_that_cannot_be_neither_moves_nor_stops_a_robot_that_is_commanded_well(
    left: float, age: float, why: str
) -> None:
    gate = Gate()
    for k in range(100):
        now = 10.0 + 0.02 * k
        gate.command(now, 0.25, 0.25)
        gate.command(now + 0.01, left, 0.25, age=age)
        assert gate.drive(now + 0.01) == Drive(0.25, 0.25, 0)
    assert gate.rejected == {why: 100}
    assert why in gate.remarks()[-1]
