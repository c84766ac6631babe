"""The checks of scripts/soak find what must not be; else an hour without findings would prove nothing."""

import importlib
import math
import sys
from typing import Any

import pytest

from cmr.bus.messages import make
from cmr.msg import gyro_t, motor_feedback_t
from tests.support.project import PROJECT

sys.path.insert(0, str(PROJECT / "scripts"))
checks: Any = importlib.import_module("soaking.checks")
robot: Any = importlib.import_module("soaking.robot")

EPOCH, TURN = 1_700_000_000_000_000, 20_000  # us
RADIANS = 2.0 * math.pi / 2048  # of a tick


class Hour:
    """A robot that drives 10 ticks a turn, what it says of it, and what is published; all is well."""

    def __init__(self) -> None:
        self.findings = checks.Findings()
        self.ground_truth, self.waits = checks.GroundTruth(), checks.WaitHistory()
        self.gaps = checks.Gaps("MOTOR_FEEDBACK", "motor", TURN, self.ground_truth, self.waits, self.findings)
        self.motor = checks.MotorChecks(self.ground_truth, self.gaps, self.waits, self.findings)
        self.drive = checks.DriveChecks(self.ground_truth, self.gaps, self.waits, self.findings, 0.8)
        self.turns = 0

    def note(self, kind: str, value: Any, utime: int | None = None) -> None:
        record = robot.Record(self.utime if utime is None else utime, kind, value)
        self.ground_truth.add(record)
        if kind == "duty":
            self.drive.check(record)

    @property
    def utime(self) -> int:
        return EPOCH + self.turns * TURN

    def turn(self, *, told: bool = True, **lies: Any) -> None:
        self.turns += 1
        count = 10 * self.turns
        self.note("counts", (count, count))
        self.note("duty", (8192, 8192))
        self.note("battery", (12.4,))
        speed = 10 * RADIANS / (TURN / 1e6)
        truth: dict[str, Any] = {"utime": self.utime, "received_utime": self.utime + 1000, "robot_id": 0, "status": 0}
        truth |= {"applied_utime": self.utime - 3000}
        truth |= {"ticks_left": count, "ticks_right": count, "psi_left": speed, "psi_right": speed}
        truth |= {"applied_left": 8192 / 32767, "applied_right": 8192 / 32767, "battery_voltage": 12.4}
        truth |= dict.fromkeys(("current_left", "current_right", "temperature"), math.nan)
        if told:
            self.motor.check(make(motor_feedback_t, **(truth | lies)))


@pytest.fixture
def hour() -> Hour:
    result = Hour()
    for _ in range(20):
        result.turn()
    assert result.findings.failures == []
    return result


@pytest.mark.parametrize(
    ("lies", "said"),
    [
        ({"ticks_left": 1}, "not what was answered"),
        ({"psi_right": 100.0}, "psi_right"),
        ({"applied_left": 0.1}, "duty"),
        ({"battery_voltage": 11.0}, "battery"),
        ({"utime": EPOCH}, "not later than the last one"),
    ],
)
def test_what_was_never_said_is_found(hour: Hour, lies: dict[str, Any], said: str) -> None:
    hour.turn(**lies)
    assert any(said in finding for finding in hour.findings.failures)


@pytest.mark.parametrize(("damages", "held_up", "is_found"), [(0, 0, True), (3, 0, False), (0, 200_000, False)])
def test_a_gap_without_a_cause_is_found(hour: Hour, damages: int, held_up: int, is_found: bool) -> None:
    hour.waits.add(hour.utime, 0)
    for _ in range(9):
        hour.turn(told=False)
    hour.waits.add(hour.utime, held_up)
    hour.note("damage", ("motor", damages))
    hour.turn()
    assert any("paused for 0.200 s" in finding for finding in hour.findings.failures) == is_found


def test_a_fault_explains_a_gap_and_other_counts_after_it_but_nothing_later(hour: Hour) -> None:
    hour.gaps.windows.append(checks.Window("MOTOR_FEEDBACK", "unplugged", hour.utime, hour.utime + 20 * TURN))
    hour.turns += 10
    hour.turn(ticks_left=1)
    assert hour.findings.failures == []
    hour.turn(ticks_left=500)
    assert any("not what was answered" in finding for finding in hour.findings.failures)


@pytest.mark.parametrize(("zero_after", "moves_again", "is_found"), [(1, 0, False), (40, 0, True), (1, 60, True)])
def test_a_lost_emergency_stop_is_found(hour: Hour, zero_after: int, moves_again: int, is_found: bool) -> None:
    engaged = hour.utime
    begin, end = engaged + checks.STOP_WITHIN, engaged + 100 * TURN
    hour.drive.intervals.append(checks.Interval(begin, end, True, "an emergency stop", engaged))
    hour.note("duty", (0, 0), engaged + zero_after * TURN)
    if moves_again:
        hour.note("duty", (100, 100), engaged + moves_again * TURN)
    hour.note("upto", None, end + 1)
    hour.drive.judge()
    assert any("were driven after an emergency stop" in finding for finding in hour.findings.failures) == is_found


def test_a_duty_that_nobody_commanded_and_a_jump_from_rest_are_found(hour: Hour) -> None:
    hour.note("duty", (0, 0))
    hour.note("duty", (31128, 0))
    assert any("never commanded" in finding for finding in hour.findings.failures)
    assert any("jumps" in finding for finding in hour.findings.failures)


@pytest.mark.parametrize(("rate", "valid", "is_found"), [(0.5, 1, False), (0.6, 1, True), (math.nan, 0, False)])
def test_a_rate_that_was_never_sent_is_found(hour: Hour, rate: float, valid: int, is_found: bool) -> None:
    gyro = checks.GyroChecks(hour.ground_truth, hour.gaps, hour.waits, hour.findings)
    hour.note("rate", (0.5, True))
    message = make(
        gyro_t, utime=hour.utime + 1, robot_id=0, yaw_rate=rate, valid=valid, received_utime=hour.utime + 2000
    )
    gyro.check(message)
    assert any("not what was sent" in finding for finding in hour.findings.failures) == is_found
