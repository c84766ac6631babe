"""The emergency stop as processes obey it: what is asked for on ESTOP, and what drivers keep."""

from typing import Any

from cmr.bus.estop import EmergencyStop, local_time
from cmr.bus.messages import make
from cmr.bus.streams import ESTOP, ESTOP_LATCH
from cmr.msg import estop_t
from tests.support.latches import NOW, latch

SECOND = 1_000_000  # us


def ask(stop: EmergencyStop, engaged: bool) -> None:
    stop.handle(NOW, ESTOP.name, make(estop_t, utime=NOW, engaged=engaged, source="hand", reason="a child"))


def report(stop: EmergencyStop, robot_id: int, engaged: bool, **fields: Any) -> None:
    stop.handle(NOW, ESTOP_LATCH.channel(robot_id), latch(robot_id, engaged, **fields))


def test_who_asks_stops_all_robots_and_a_driver_keeps_its_own() -> None:
    stop = EmergencyStop()
    assert not stop.engaged
    ask(stop, True)
    assert stop.reason == "hand: a child"
    assert stop.holds(0)
    report(stop, 3, True)
    ask(stop, False)
    assert stop.engaged
    assert (stop.holds(0), stop.holds(3)) == (False, True)
    report(stop, 3, False)
    assert not stop.engaged
    assert stop.reason == ""


def test_the_stop_that_has_held_longest_is_named_with_all_robots() -> None:
    stop = EmergencyStop()
    report(stop, 3, True, since_utime=NOW + SECOND)
    report(stop, 1, True, source="Grace", reason="toast")
    assert stop.reason == f"Grace: toast (robots 1, 3, since {local_time(NOW)})"
    report(stop, 1, False)
    assert stop.reason == f"Ada: smoke (robot 3, since {local_time(NOW + SECOND)})"


def test_a_stop_without_words_is_a_stop() -> None:
    stop = EmergencyStop()
    stop.handle(NOW, ESTOP.name, make(estop_t, utime=NOW, engaged=True, source="", reason=""))
    assert stop.engaged


def test_a_stamp_that_no_clock_shows_is_no_error() -> None:
    assert local_time(-(2**63)) == local_time(2**63 - 1) == "a time that no clock shows"
