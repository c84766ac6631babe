"""Of two programs that publish poses of the same robot, the one that came later yields."""

import time

import pytest

from cmr.bus.bus import Bus
from cmr.bus.messages import make
from cmr.bus.streams import POSE
from cmr.msg import pose_xyt_t
from cmr.tracker.elsewhere import FIRST_LOOK, LOOK, PERIOD, Elsewhere
from tests.support.private_bus import private_url
from tests.support.taken import threads

pytestmark = pytest.mark.waits


def send(bus: Bus, robot_id: int, utime: int) -> None:
    bus.publish(POSE, make(pose_xyt_t, utime=utime, robot_id=robot_id, x=0.0, y=0.0, theta=0.0), robot_id)
    time.sleep(0.05)  # the loopback's way


def look(elsewhere: Elsewhere, now: float, length: float, bus: Bus, sent: "list[tuple[int, int]]") -> None:
    """Look once; meanwhile these poses, by robot and stamp, are sent by another program."""
    elsewhere.look(now)
    for robot_id, utime in sent:
        send(bus, robot_id, utime)
    elsewhere.look(now + length)


def test_robots_that_have_poses_already_are_left_to_the_other_program_until_it_stops() -> None:
    url = private_url()
    other = Bus(url)
    elsewhere = Elsewhere(lambda: Bus(url), [0, 1])
    look(elsewhere, 0.0, FIRST_LOOK, other, [(1, 100)])
    assert elsewhere.is_decided
    assert elsewhere.yielded == {1}
    assert elsewhere.problem() == (
        "Another program publishes poses of robot 1: only one may; these are not published here."
    )
    look(elsewhere, FIRST_LOOK + PERIOD, LOOK, other, [])  # at robot 0
    assert elsewhere.yielded == {1}
    look(elsewhere, FIRST_LOOK + 3.0 * PERIOD, LOOK, other, [])
    assert elsewhere.yielded == set()
    assert elsewhere.problem() == ""


def test_a_program_that_comes_later_is_reported_and_own_poses_are_not_taken_for_its() -> None:
    url = private_url()
    other = Bus(url)
    elsewhere = Elsewhere(lambda: Bus(url), [0, 1])
    look(elsewhere, 0.0, FIRST_LOOK, other, [])
    for robot_id, begin in ((0, FIRST_LOOK + PERIOD), (1, FIRST_LOOK + 3.0 * PERIOD)):
        elsewhere.look(begin)
        elsewhere.note(0, 200)
        send(other, 0, 200)  # as if sent here
        send(other, 1, 201)
        elsewhere.look(begin + LOOK)
        assert elsewhere.others == {*range(1, robot_id + 1)}
    assert elsewhere.yielded == set()
    assert "Another program publishes poses of robot 1" in elsewhere.problem()


def test_looks_leave_nothing_behind_that_listens() -> None:
    url = private_url()
    elsewhere = Elsewhere(lambda: Bus(url), [0, 1])
    before = threads()
    for begin in (0.0, FIRST_LOOK + PERIOD, FIRST_LOOK + 3.0 * PERIOD):
        elsewhere.look(begin)
        assert threads() == before + 1
        elsewhere.look(begin + FIRST_LOOK)
        assert threads() == before
