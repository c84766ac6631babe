"""What is said of a team in the report is what its robots did."""

import math
import socket
import tracemalloc

import numpy as np
import pytest

from cmr.bus.streams import PROCESS_STATUS, WORLD_STATE
from cmr.experiments.live.track import Track
from cmr.experiments.live.watch import TeamWatch
from cmr.experiments.team.plan import RobotPlan, Scenario
from cmr.model.motion import RobotState
from cmr.msg import process_status_t
from cmr.world.view import REAL, TWIN, VIRTUAL, Robot, world_messages
from tests.support.small_log import process_status

EPOCH = 1_700_000_000_000_000
STEP = 20_000  # us


def watch(*waypoints: tuple[float, float], robots: int = 2) -> TeamWatch:
    plans = tuple(RobotPlan(k, "virtual", waypoints=waypoints if k == 0 else ()) for k in range(robots))
    return TeamWatch(Scenario("test", 10.0, plans))


def see(watched: TeamWatch, k: int, *robots: tuple[int, int, float, float], speed: float = 0.0) -> None:
    """Show the world at step k: robots by id, origin, x and y."""
    utime = EPOCH + k * STEP
    states = [Robot(utime, i, origin, RobotState(x, y, 0.0, speed, speed, 0.0, 0.0)) for i, origin, x, y in robots]
    (message,) = world_messages(utime, states)
    watched.handle(utime, WORLD_STATE.name, message)


def test_the_distance_driven_is_that_of_the_path() -> None:
    watched = watch()
    for k in range(501):
        angle = 2.0 * np.pi * k / 500
        see(watched, k, (0, REAL, float(np.cos(angle)), float(np.sin(angle))), (1, VIRTUAL, 5.0, 0.01 * k))
    assert watched.distance == pytest.approx([2.0 * np.pi, 5.0], rel=0.01)
    assert watched.measure("distance_driven") == pytest.approx((2.0 * np.pi + 5.0) / 2.0, rel=0.01)
    assert watched.rate() == pytest.approx(50.0)


def test_a_robot_that_trembles_drives_nowhere() -> None:
    random = np.random.default_rng(0)
    watched = watch()
    for k in range(2000):
        see(watched, k, (0, REAL, *(0.003 * random.standard_normal(2)).tolist()), (1, VIRTUAL, 1.0, 0.0))
    assert watched.distance.max() < 0.05


def test_the_nearest_two_robots_are_named_and_twins_do_not_count() -> None:
    watched = watch(robots=3)
    for k in range(100):
        x = abs(k - 50) * 0.02 + 0.3
        see(watched, k, (0, REAL, 0.0, 0.0), (0, TWIN, 0.0, 0.0), (1, VIRTUAL, 5.0, 0.0), (2, VIRTUAL, x, 0.0))
    assert watched.nearest.distance == pytest.approx(0.3)
    assert watched.nearest.robots == (0, 2)
    assert watched.nearest.utime == EPOCH + 50 * STEP


def test_waypoints_count_in_their_order_only() -> None:
    watched = watch((1.0, 0.0), (2.0, 0.0))
    for k, x in enumerate((0.0, 2.0, 1.05, 0.5)):
        see(watched, 10 * k, (0, VIRTUAL, x, 0.0), (1, VIRTUAL, 9.0, 0.0))
    assert watched.remaining_waypoints() == {0: ((2.0, 0.0),)}
    assert not watched.waypoints_reached
    see(watched, 50, (0, VIRTUAL, 1.95, 0.0), (1, VIRTUAL, 9.0, 0.0))
    assert watched.waypoints_reached
    assert watched.reached_utime == {0: EPOCH + 50 * STEP}


def test_robots_that_are_not_there_yet_or_not_any_more_are_missing() -> None:
    watched = watch(robots=3)
    assert watched.missing() == [0, 1, 2]
    see(watched, 0, (0, REAL, 0.0, 0.0), (1, VIRTUAL, 1.0, 0.0))
    assert watched.missing() == [2]
    see(watched, 60, (1, VIRTUAL, 1.0, 0.0))
    assert watched.missing() == [0, 2]
    assert watched.nearest.distance == pytest.approx(1.0)


def test_robots_of_others_are_passed_over() -> None:
    watched = watch()
    see(watched, 0, (0, VIRTUAL, 0.0, 0.0), (1, VIRTUAL, 1.0, 0.0), (99, VIRTUAL, 0.1, 0.0))
    assert watched.nearest.distance == pytest.approx(1.0)


def test_a_long_run_keeps_a_bounded_number_of_places(monkeypatch: pytest.MonkeyPatch) -> None:
    most = 100
    monkeypatch.setattr("cmr.experiments.live.track.MOST_MOMENTS", most)
    watched = watch()
    for k in range(3 * most):
        see(watched, 5 * k, (0, VIRTUAL, 0.001 * k, 0.0), (1, VIRTUAL, 0.0, 1.0))
    track = watched.track
    assert most / 2 < len(track) <= most
    spacing = np.diff(track.utime)
    assert spacing.max() == spacing.min() == 4 * 5 * STEP
    assert track.utime[-1] > EPOCH + 0.95 * 15 * most * STEP
    assert track.places[:, 0, 0] == pytest.approx((track.utime - EPOCH) / (5 * STEP) * 0.001, rel=1e-6)


def test_a_thousand_robots_take_no_more_memory_in_a_week_than_in_minutes() -> None:
    robots, hour = 1000, 36_000  # moments
    track = Track(robots, 100_000)
    places = np.ones((2, robots))
    assert track.places.base is not None
    size = track.places.base.nbytes
    assert size <= 16_000_000
    tracemalloc.start()
    before = tracemalloc.get_traced_memory()[0]
    for k in range(hour):
        track.add(100_000 * k, places)
    grown, peak = (value - before for value in tracemalloc.get_traced_memory())
    tracemalloc.stop()
    assert peak < 100_000, "nothing is set aside while it goes on"
    assert grown < 10_000
    for k in range(hour, 168 * hour, 100):  # the rest of a week, of which it keeps less and less
        track.add(100_000 * k, places)
    assert track.places.base.nbytes == size
    assert len(track) >= track.most // 2


def test_what_robots_did_before_all_were_in_service_does_not_count() -> None:
    watched = watch((9.0, 0.0))
    for k in range(50):
        see(watched, 5 * k, (0, VIRTUAL, 0.1 * k, 0.0), (1, VIRTUAL, 0.5, 1.0))
    assert watched.nearest.distance == pytest.approx(1.0)
    watched.begin()
    assert watched.measure("distance_driven") == 0.0
    for k in range(50, 60):
        see(watched, 5 * k, (0, VIRTUAL, 0.1 * k, 0.0), (1, VIRTUAL, 0.5, 1.0))
    assert watched.distance == pytest.approx([1.0, 0.0])
    assert watched.nearest.distance > 4.0


def status(pid: int, state: int, overruns: float, host: str = socket.gethostname()) -> process_status_t:
    return process_status(EPOCH, host=host, pid=pid, state=state, loop_rate_hz=200.0, loop_overruns=overruns)


def test_late_turns_of_all_processes_are_added_up_and_a_doubt_is_known() -> None:
    watched = watch()
    for overruns in (1.0, 3.0):
        watched.handle(EPOCH, PROCESS_STATUS.name, status(7, process_status_t.RUNNING, overruns))
    watched.handle(EPOCH, PROCESS_STATUS.name, status(8, process_status_t.DEGRADED, 2.0))
    assert watched.overruns == 5
    assert [watched.is_degraded(pid) for pid in (7, 8, 9)] == [False, True, False]


@pytest.mark.parametrize("overruns", [math.nan, math.inf, -1.0, 1e300])
def test_a_status_with_numbers_that_cannot_be_is_passed_over(overruns: float) -> None:
    watched = watch()
    watched.handle(EPOCH, PROCESS_STATUS.name, status(7, process_status_t.RUNNING, 3.0))
    watched.handle(EPOCH, PROCESS_STATUS.name, status(7, process_status_t.RUNNING, overruns))
    watched.handle(EPOCH, PROCESS_STATUS.name, status(8, process_status_t.RUNNING, overruns))
    assert (watched.overruns, watched.late_turns(8)) == (3, None)


def test_a_robot_whose_place_cannot_be_is_not_seen() -> None:
    watched = watch()
    see(watched, 0, (0, VIRTUAL, math.nan, 0.0), (1, VIRTUAL, 1.0, 0.0))
    assert watched.missing() == [0]


def test_what_came_late_while_processes_started_up_does_not_count() -> None:
    watched = watch()
    watched.handle(EPOCH, PROCESS_STATUS.name, status(7, process_status_t.RUNNING, 100.0))
    see(watched, 0, (0, VIRTUAL, 0.0, 0.0), (1, VIRTUAL, 0.0, 1.0))
    watched.begin()
    watched.handle(EPOCH, PROCESS_STATUS.name, status(7, process_status_t.RUNNING, 103.0))
    watched.handle(EPOCH, PROCESS_STATUS.name, status(8, process_status_t.RUNNING, 2.0))
    see(watched, 1, (0, VIRTUAL, 0.0, 0.0), (1, VIRTUAL, 0.0, 1.0))
    assert [watched.late_turns(pid) for pid in (7, 8, 9)] == [3, 2, None]
    assert [watched.loop_rate(pid) for pid in (7, 9)] == [200.0, 0.0]
    assert watched.overruns == 5
    assert watched.worlds == 1
