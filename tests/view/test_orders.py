"""What cmr-view sends when its buttons are pressed, and for whom."""

import pytest

from cmr.bus.estop import RELEASES
from cmr.bus.messages import make
from cmr.bus.streams import (
    ESTOP_LATCH,
    WAYPOINTS,
)
from cmr.msg import (
    estop_t,
    waypoints_t,
)
from cmr.view.orders import Orders
from cmr.view.requests import RELEASE, STOP, Permission
from cmr.view.showing import stop_line
from tests.support.latches import latch
from tests.support.typed_messages import as_a

NOW = 1_700_000_000_000_000  # us


def sent(orders: Orders, utime: int) -> list[bool]:
    return [bool(message.engaged) for _, _, message in orders.due(utime) if isinstance(message, estop_t)]


def test_a_stop_is_repeated_until_it_is_released_and_the_release_is_newer() -> None:
    orders = Orders()
    orders.stop(NOW)
    assert [sent(orders, NOW + k) for k in range(3)] == [[True], [True], [True]]
    assert orders.stopped
    orders.release()
    releases = [as_a(estop_t, message) for k in range(10) for _, _, message in orders.due(NOW + 10 + k)]
    assert len(releases) == RELEASES
    assert {(message.utime, message.engaged) for message in releases} == {(NOW + 10, False)}, "it ends no later stop"
    assert not orders.stopped


def test_anybody_may_release_a_stop_but_not_with_words_from_before_it() -> None:
    orders = Orders()
    orders.stop(NOW)
    release = {"engaged": False, "source": "a person", "reason": "all is well"}
    orders.handle(NOW, "ESTOP", make(estop_t, utime=NOW - 1, **release))
    assert sent(orders, NOW) == [True]
    orders.handle(NOW, "ESTOP", make(estop_t, utime=NOW + 1, **release))
    assert sent(orders, NOW) == []
    assert not orders.stopped


def test_a_stop_of_somebody_else_is_shown_and_not_repeated_and_ours_that_echoes_engages_nothing() -> None:
    orders = Orders()
    orders.handle(NOW, "ESTOP", make(estop_t, utime=NOW, engaged=True, source="cmr-run", reason="a fence was left"))
    assert orders.reason == "cmr-run: a fence was left"
    assert sent(orders, NOW) == []
    orders.stop(NOW)
    [(_, _, echo)] = orders.due(NOW)
    orders.release()
    orders.handle(NOW + 2, "ESTOP", echo)
    assert not orders.stopped


def test_a_stop_that_drivers_hold_is_shown_until_each_has_released_it() -> None:
    orders = Orders()
    for robot_id in (7, 2):
        orders.handle(NOW, ESTOP_LATCH.channel(robot_id), latch(robot_id, True))
    assert "engaged by Ada: smoke (robots 2, 7, since 2023-11-1" in stop_line(orders)
    assert not orders.stopped, "nobody asks for it any more"
    assert orders.must_stand(7)
    assert not orders.must_stand(1)
    orders.release()
    orders.handle(NOW, ESTOP_LATCH.channel(7), latch(7, False))
    assert "(robot 2, since" in stop_line(orders), "robot 2 has not taken the release"
    orders.handle(NOW, ESTOP_LATCH.channel(2), latch(2, False))
    assert stop_line(orders) == ""


def test_a_figure_eight_begins_and_ends_where_the_robot_is() -> None:
    orders = Orders()
    orders.figure_eight(NOW, 7, (1.0, 2.0, 0.5))
    [(stream, robot_id, sent)] = orders.due(NOW)
    message = as_a(waypoints_t, sent)
    assert (stream, robot_id, message.robot_id) == (WAYPOINTS, 7, 7)
    assert (message.x[0], message.y[0], message.x[-1], message.y[-1]) == pytest.approx((1.0, 2.0, 1.0, 2.0))


def test_nothing_is_done_without_the_token() -> None:
    permission = Permission("secret of ours")
    assert not permission.asks(RELEASE)
    assert not permission.try_token("secret")
    assert not permission.asks(RELEASE)
    assert permission.try_token(" secret of ours\n")
    assert permission.asks(RELEASE)
    assert permission.refused == 2


def test_on_this_computer_everybody_may_stop_but_only_the_token_releases() -> None:
    permission = Permission("secret of ours", on_this_computer=True)
    assert permission.asks(STOP)
    assert not permission.asks(RELEASE)
    assert not Permission("secret of ours").asks(STOP), "who sees the page from elsewhere needs the token"
