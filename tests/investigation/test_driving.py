"""The drive of an investigation: what comes late, near the border, or after an interruption ends in a rest."""

import math
import time
from dataclasses import replace
from functools import partial
from threading import Event
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from cmr.geometry.obstacles import Geofence
from cmr.investigation.driving import (
    INTERRUPTED,
    MOST_PAUSES,
    MOST_PAUSES_UNSEEN,
    NEAR_THE_BORDER,
    PAUSE,
    SPARE,
    AtOnce,
    Driving,
    InThread,
    Place,
    Planner,
    Shift,
)
from cmr.investigation.engine import NO_ROOM, UNSURE, Planned
from cmr.investigation.floor import Floor
from cmr.investigation.movements import PERIOD, Movement, waiting
from cmr.investigation.reckoning import SURE, Reckoned, put_down
from cmr.recordings.signal import Floats
from tests.investigation.planners import Never, Slow

FLOOR = Floor(Geofence([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]))
MIDDLE = Place(0.0, 0.0, 0.0, 0.0)
TICK = round(PERIOD * 1e6)  # us
FORWARD = Movement("forward", np.full((50, 2), 0.4))


class Scripted:
    """An investigation that always chooses the same movement, or none; it counts its decisions."""

    def __init__(
        self,
        movement: Movement | None,
        finished_after: int = 10**6,
        refused: str = "",
        reckoned: Reckoned | None = None,
    ) -> None:
        self.floor, self.decisions, self._movement = FLOOR, 0, movement
        self._finished_after, self._refused, self._reckoned = finished_after, refused, reckoned
        self.waited = 0.0

    def opening(self, _x: float, _y: float, _theta: float) -> tuple[Movement, str]:
        """Return a short opening."""
        return Movement("opening", np.full((10, 2), 0.25)), self._refused

    def decide(self, _recording: object, planned: Planned, least: float) -> SimpleNamespace:
        """Return the same movement."""
        self.decisions += 1
        self.planned, self.least = planned, least
        over = self.decisions > self._finished_after
        choice = SimpleNamespace(movement=self._movement)
        none = NO_ROOM if self._reckoned is None else UNSURE
        sentence = "" if self._movement else none
        return SimpleNamespace(choice=choice, finished=over, sentence=sentence, reckoned=self._reckoned)


def driving_of(investigation: Scripted, planner: Planner | None = None) -> Driving:
    """Return the drive of such an investigation."""
    return Driving(cast(Any, investigation), lambda: cast(Any, None), planner or AtOnce())


def driven(driving: Driving, seconds: float, place: Place = MIDDLE, begin: int = 0) -> Floats:
    """Return the commands of so many seconds, (n, 2)."""
    return np.array([driving.command(begin + k * TICK, place) for k in range(round(seconds / PERIOD))])


def test_movements_follow_one_another_without_a_rest() -> None:
    """After the opening and reversals, in which the first movement is planned, there is no gap between movements."""
    driving = driving_of(Scripted(FORWARD))
    duties = driven(driving, 6.0)
    begin = int(np.flatnonzero(duties[:, 0] == 0.4)[0])
    assert begin <= 10 + 51
    assert np.all(duties[begin:] == 0.4)


def test_the_next_movement_is_planned_while_one_is_driven() -> None:
    """What is planned begins where the movement being driven ends: that is what the engine was told."""
    investigation = Scripted(FORWARD)
    driving = driving_of(investigation)
    driven(driving, 3.0)
    assert investigation.decisions == 3
    assert np.all(investigation.planned.duty == 0.4)


def test_a_robot_whose_planner_is_late_stands_still() -> None:
    """Without a decision nothing is driven after the opening and the reversals behind it."""
    driving = driving_of(Scripted(FORWARD), Never())
    assert np.all(driven(driving, 10.0)[10 + len(waiting().duty) :] == 0.0)
    assert not driving.finished


def test_it_stops_at_once_near_the_border() -> None:
    """A robot that, stopped now, would come within half of the margin of the border gets no duty at all."""
    driving = driving_of(Scripted(FORWARD))
    driven(driving, 2.0)
    near = Place(0.80, 0.0, 0.0, 0.7)  # 0.94 m with the way to stop; 0.93 m are allowed
    assert driving.command(100 * TICK, near) == (0.0, 0.0)
    assert driving.note == NEAR_THE_BORDER


def test_after_an_interruption_it_goes_on_from_rest() -> None:
    """Poses that were missing, or an emergency stop: the movement that was interrupted is not driven on."""
    driving = driving_of(Scripted(FORWARD))
    driven(driving, 2.0)
    later = 100 * TICK + 3_000_000
    assert driving.command(later, MIDDLE) == (0.0, 0.0)
    assert driving.note == INTERRUPTED.format(seconds=(later - 99 * TICK) * 1e-6)
    assert np.any(driven(driving, 2.0, begin=later)[-10:] == 0.4)


def test_what_is_decided_while_it_stands_is_driven_however_long_it_took() -> None:
    """A robot at rest is where the decision has it: a computer too slow for one second of driving drives all the same.

    It is given movements in which there is time for a decision.
    """
    investigation = Scripted(FORWARD)
    driving = driving_of(investigation, Slow(70))  # asked once a turn, from the end of a movement on
    duties = driven(driving, 20.0)
    assert np.mean(duties[:, 0] == 0.4) > 0.2
    assert investigation.least == 70 * PERIOD


def test_what_a_robot_waits_for_late_decisions_is_no_time_of_driving() -> None:
    """On a slow computer a drive takes longer, and drives as long."""
    quick, slow = Scripted(FORWARD), Scripted(FORWARD)
    driven(driving_of(quick), 20.0)
    assert quick.waited == 0.0
    driving = driving_of(slow, Slow(70))
    driven(driving, 20.0)
    under_way = 1.0  # s, of a movement and of a rest that are not over yet
    assert slow.waited + driving.drove == pytest.approx(20.0, abs=2.0 * under_way)
    assert slow.waited > 10.0


def test_an_end_that_is_decided_late_is_an_end() -> None:
    """Whatever the robot did meanwhile: nothing is left to be found out."""
    driving = driving_of(Scripted(FORWARD, finished_after=0), Slow(70))
    driven(driving, 5.0)
    assert driving.finished


def test_an_opening_that_was_interrupted_begins_again() -> None:
    """Without it, the first choices would rest on a second of data; of what was interrupted, the part driven counts."""
    driving = driving_of(Scripted(FORWARD))
    driven(driving, 3 * PERIOD)
    later = 3 * TICK + 1_000_000
    assert np.all(driven(driving, 10 * PERIOD, begin=later) == 0.25)
    assert driving.drove == pytest.approx(2 * PERIOD + 10 * PERIOD)
    for begin in (2 * later, 3 * later):
        driven(driving, 3 * PERIOD, begin=begin)
    assert driving.movement is None, "after three openings it goes on with what it has"


def test_at_the_end_nothing_is_decided_any_more() -> None:
    """What an investigation reports must not change while the report is made."""
    planner, began, ended = InThread(), Event(), Event()

    def decide() -> None:
        began.set()
        time.sleep(0.05)
        ended.set()

    planner.begin(decide)
    began.wait()
    driving_of(Scripted(FORWARD), planner).end()
    assert ended.is_set()


def test_the_time_that_decisions_take_is_that_of_the_longest_lately() -> None:
    """The next movement is chosen so that it lasts as long, and a quarter longer."""
    planner = InThread()
    assert planner.seconds == 0.0
    for seconds in (0.05, 0.0):
        planner.begin(partial(time.sleep, seconds))
        while not planner.result()[0]:
            time.sleep(0.001)
    assert planner.seconds >= SPARE * 0.05


def test_a_floor_without_room_ends_it_with_a_sentence() -> None:
    """Where no movement keeps to the floor, it ends after some rests; where the opening does not, at once."""
    driving = driving_of(Scripted(None))
    driven(driving, (MOST_PAUSES + 3) * 1.1)
    assert driving.finished
    assert driving.problem == NO_ROOM
    refused = driving_of(Scripted(FORWARD, refused="No."))
    assert refused.command(0, MIDDLE) == (0.0, 0.0)
    assert (refused.finished, refused.problem) == (True, "No.")


def test_it_ends_when_nothing_is_left_to_be_found_out() -> None:
    """A decision that says so ends the drive."""
    driving = driving_of(Scripted(FORWARD, finished_after=3))
    driven(driving, 10.0)
    assert driving.finished
    assert driving.command(10**9, MIDDLE) == (0.0, 0.0)
    assert driving.problem == ""


def test_a_place_of_one_frame_moves_in_another_as_it_did() -> None:
    """A robot that went 0.3 m ahead in its own estimate did so from where it was reckoned to be."""
    began, same = Place(0.4, -0.2, 1.0, 0.1), (1.0, 2.0, -0.5)
    shift = Shift.between(began, same)
    ahead = Place(0.4 + 0.3 * math.cos(1.0), -0.2 + 0.3 * math.sin(1.0), 1.2, 0.1)
    x, y, theta, speed = (getattr(shift.of(ahead), name) for name in ("x", "y", "theta", "speed"))
    assert (x, y) == pytest.approx((1.0 + 0.3 * math.cos(-0.5), 2.0 + 0.3 * math.sin(-0.5)))
    assert (theta, speed) == pytest.approx((-0.3, 0.1))


def test_a_place_that_is_only_reckoned_is_kept_further_inside() -> None:
    """Where the robot may be 0.3 m off, it stops 0.3 m sooner; without a doubt it drives on there."""
    down = put_down((0.7, 0.0, 0.0), 0.16, with_gyro=True)
    unsure = replace(down, off=np.full_like(down.off, 0.3 / SURE / math.sqrt(down.off.size)))
    for reckoned, rests in ((None, False), (down, False), (unsure, True)):
        driving = driving_of(Scripted(FORWARD, reckoned=reckoned))
        driven(driving, 3.0, Place(0.7, 0.0, 0.0, 0.0))
        assert (driving.note == NEAR_THE_BORDER) == rests


def test_a_drive_whose_place_is_too_unsure_ends_and_says_so() -> None:
    """The doubt does not shrink while the robot stands: it does not try for long."""
    down = put_down((0.0, 0.0, 0.0), 0.16, with_gyro=True)
    driving = driving_of(Scripted(None, reckoned=down))
    driven(driving, (MOST_PAUSES_UNSEEN + 2) * (PAUSE + 1.0) + 3.0)
    assert driving.finished
    assert driving.problem == UNSURE
