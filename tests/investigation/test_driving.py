"""The drive of an investigation: what comes late, near the border, or after an interruption ends in a rest."""

import math
from dataclasses import replace
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
    AtOnce,
    Driving,
    Place,
    Planner,
    Shift,
)
from cmr.investigation.engine import NO_ROOM, UNSURE, Planned
from cmr.investigation.floor import Floor
from cmr.investigation.movements import PERIOD, Movement, waiting
from cmr.investigation.reckoning import SURE, Reckoned, put_down
from cmr.recordings.signal import Floats

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

    def opening(self, _x: float, _y: float, _theta: float) -> tuple[Movement, str]:
        """Return a short opening."""
        return Movement("opening", np.full((10, 2), 0.25)), self._refused

    def decide(self, _recording: object, planned: Planned) -> SimpleNamespace:
        """Return the same movement."""
        self.decisions += 1
        self.planned = planned
        over = self.decisions > self._finished_after
        choice = SimpleNamespace(movement=self._movement)
        none = NO_ROOM if self._reckoned is None else UNSURE
        sentence = "" if self._movement else none
        return SimpleNamespace(choice=choice, finished=over, sentence=sentence, reckoned=self._reckoned)


class Never:
    """A planner that is never ready."""

    def begin(self, deciding: object) -> None:
        """Do not decide."""

    def result(self) -> tuple[bool, None]:
        """Return that nothing is there."""
        return False, None


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
