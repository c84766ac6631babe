"""One process commands a robot at a time: others are refused and reported, and taking over is explicit."""

import signal
import time
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cmr.bus.bus import Bus
from cmr.bus.claiming import LAPSE, Claim, Ownership
from cmr.bus.messages import make, now_utime
from cmr.bus.streams import COMMAND_CLAIM, COMMAND_OWNER, MOTOR_COMMAND
from cmr.msg import command_claim_t, command_owner_t, motor_command_t
from robot_driver.host import Host
from tests.support.driver_bench import URL, DriverProcess, driving

FIRST, SECOND = 11, 22
CLAIM, TAKE_OVER, END = command_claim_t.CLAIM, command_claim_t.TAKE_OVER, command_claim_t.END
FORWARD, BACKWARD = 16384, -16384


class StillHost(Host):
    """A computer whose time a test sets [s]."""

    now = 1000.0

    def monotonic(self) -> float:
        return self.now

    def utime(self) -> int:
        return round(self.now * 1e6)


class Robot:
    """The decisions of one robot's driver, as processes see them."""

    def __init__(self) -> None:
        self.host = StillHost()
        self.ownership = Ownership(0, self.host)

    def claim(self, sender: int | None, action: int = CLAIM, late: int = 0) -> None:
        utime = self.host.utime() - late
        message = make(command_claim_t, utime=utime, robot_id=0, action=action, claimant=f"process {sender}")
        self.ownership.claim(message, sender)

    def takes(self) -> set[int | None]:
        """Return whose commands are taken."""
        return {sender for sender in (FIRST, SECOND, None) if self.ownership.takes(sender)}


def test_who_claims_first_has_the_robot_and_others_are_refused_and_reported() -> None:
    robot = Robot()
    assert robot.takes() == {FIRST, SECOND, None}
    robot.claim(FIRST)
    robot.claim(SECOND)
    assert robot.takes() == {FIRST}
    assert "process 11 does, process 22 is refused" in robot.ownership.problem()
    robot.host.now += 0.9
    robot.claim(FIRST)
    robot.host.now += 4.2
    robot.claim(FIRST)
    assert robot.ownership.problem() == ""


def test_a_program_that_claims_nothing_is_refused_and_reported_where_somebody_claims() -> None:
    robot = Robot()
    robot.claim(FIRST)
    assert robot.takes() == {FIRST}
    assert robot.ownership.commands_refused == 2
    assert "is refused" in robot.ownership.problem()


@pytest.mark.parametrize("says_so", [True, False])
def test_an_owner_that_ends_or_falls_silent_leaves_the_robot_to_others(says_so: bool) -> None:
    robot = Robot()
    robot.claim(FIRST)
    if says_so:
        robot.claim(FIRST, END)
    else:
        robot.host.now += LAPSE + 0.01
    assert robot.takes() == {FIRST, SECOND, None}
    robot.claim(SECOND)
    assert robot.takes() == {SECOND}


def test_taking_over_is_explicit_and_told() -> None:
    robot = Robot()
    robot.claim(FIRST)
    robot.claim(SECOND, TAKE_OVER)
    robot.claim(FIRST)
    assert robot.takes() == {SECOND}
    assert robot.ownership.news == ["process 22 took over the robot from process 11"]
    robot.claim(FIRST, END)
    assert robot.takes() == {SECOND}


@pytest.mark.parametrize("late", [-600_000, 600_000])
def test_a_claim_of_another_time_counts_for_nothing(late: int) -> None:
    robot = Robot()
    robot.claim(FIRST)
    robot.claim(SECOND, TAKE_OVER, late)
    assert robot.takes() == {FIRST}


@given(st.lists(st.tuples(st.sampled_from([FIRST, SECOND, None]), st.sampled_from([CLAIM, TAKE_OVER, END, 7]))))
def test_whatever_is_claimed_one_sender_at_most_has_the_robot_or_nobody(claims: list[tuple[int | None, int]]) -> None:
    robot = Robot()
    for sender, action in claims:
        robot.claim(sender, action)
        assert len(robot.takes()) in (1, 3)


def test_a_process_learns_that_others_have_the_robot_and_that_it_was_taken_over() -> None:
    robot = Robot()
    first, second = Claim("first", 0, lambda: FIRST), Claim("second", 0, lambda: SECOND)
    taking = Claim("third", 0, lambda: 33, take_over=True)
    for claim, sender in ((first, FIRST), (second, SECOND)):
        message = claim.message(robot.host.utime())
        assert message is not None
        robot.ownership.claim(message, sender)
        assert claim.message(robot.host.utime()) is None  # not due again
    _report(robot, first, second, taking)
    assert (first.others(robot.host.utime()), second.others(robot.host.utime())) == ("", first.claimant)
    assert taking.others(robot.host.utime()) == ""
    message = taking.message(robot.host.utime())
    assert message is not None
    robot.ownership.claim(message, 33)
    _report(robot, first, second, taking)
    assert (first.lost_to, second.lost_to, taking.lost_to) == (taking.claimant, "", "")
    assert first.message(robot.host.utime() + 1_000_000) is None
    assert second.others(robot.host.utime() + 3_000_000) == ""  # the driver is gone


def _report(robot: Robot, *claims: Claim) -> None:
    robot.host.now += 0.5
    for report in robot.ownership.reports():
        for claim in claims:
            claim.handle(report.utime, "COMMAND_OWNER_0", report)


class Commander:
    """A process that claims robot 0, where it does, and commands it at 50 Hz, with a clock that is ahead [us]."""

    def __init__(self, duty: float, action: int | None, ahead: int = 0) -> None:
        self.bus = Bus(URL)
        self._duty, self._action, self._ahead = duty, action, ahead

    def command(self) -> None:
        utime = now_utime()
        if self._action is not None:
            claim = make(command_claim_t, utime=utime, robot_id=0, action=self._action, claimant="a test")
            self.bus.publish(COMMAND_CLAIM, claim, 0)
        command = make(motor_command_t, utime=utime + self._ahead, robot_id=0, left=self._duty, right=self._duty)
        self.bus.publish(MOTOR_COMMAND, command, 0)


def command_for(driver: DriverProcess, seconds: float, *commanders: Commander) -> None:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        for commander in commanders:
            commander.command()
        driver.listen(0.02)


@pytest.mark.real_time
@pytest.mark.parametrize("second", [None, CLAIM], ids=["unclaimed", "claimed"])
def test_a_second_master_reverses_no_robot_and_is_reported(tmp_path: Path, second: int | None) -> None:
    """Two masters made a robot reverse 227 times in 3 s; one with a clock 0.49 s ahead had it by itself."""
    with driving(tmp_path) as (robot, driver):
        driver.bus.subscribe(COMMAND_OWNER, every=True)
        owner, other = Commander(0.5, CLAIM), Commander(-0.5, second, ahead=490_000)
        command_for(driver, 0.5, owner)
        begin = len(robot.drives)
        command_for(driver, 3.0, owner, other)
        assert {drive[1] for drive in robot.drives[begin:]} <= {FORWARD}
        assert "More than one process commands this robot" in driver.statuses[-1].message
        reports = [message for message in driver.heard if isinstance(message, command_owner_t)]
        assert (reports[-1].sender, reports[-1].owner) == (owner.bus.sender, "a test")
        command_for(driver, 2.0, Commander(-0.5, TAKE_OVER), owner)
        assert robot.drives[-1][1] == BACKWARD
        code, said = driver.end(signal.SIGTERM)
        assert code == 130
        assert "took over the robot from" in said
