"""Drive an investigation in real time: during each movement, the next one is planned from the data so far."""

import math
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from cmr.investigation.engine import OPENING, Decision, Investigation, Planned
from cmr.investigation.movements import PERIOD, Movement, waiting
from cmr.recordings.recording import Recording
from cmr.recordings.signal import SECONDS

PAUSE = 1.0  # s of rest while the next movement is planned: a robot has stopped after half of it
STOPPING = 0.2  # s of driving at the present speed: the robot's stopping distance
MOST_PAUSES = 20  # in a row, without a movement found
MOST_PAUSES_UNSEEN = 3  # the same by dead reckoning, whose uncertainty does not shrink in a pause
LOST = 500_000  # us without a call from which the drive counts as interrupted
MOST_OPENINGS = 3  # attempts, if drives are interrupted
REMEMBERED, SPARE = 4, 1.25  # decisions whose duration counts; the next one gets this factor times the longest of them
INTERRUPTED = "The drive was interrupted for {seconds:.1f} s; it goes on from rest."
NEAR_THE_BORDER = "Stopped near the border of the floor, where no prediction had the robot; it goes on from rest."
Deciding = Callable[[], Decision | None]


class Planner(Protocol):
    """Interface of a planner: it begins a decision and returns it when it is ready."""

    @property
    def seconds(self) -> float:
        """Duration of a decision [s]; after a shorter movement the robot must wait."""

    def begin(self, deciding: Deciding) -> None:
        """Begin to decide."""

    def result(self) -> tuple[bool, Decision | None]:
        """Return whether a decision is ready, and the decision."""

    def end(self) -> None:
        """Wait for a pending decision, so that the investigation is idle."""


class AtOnce:
    """A planner that takes no time, for simulated time."""

    seconds = 0.0

    def __init__(self) -> None:
        self._decision: Decision | None = None

    def begin(self, deciding: Deciding) -> None:
        """Decide."""
        self._decision = deciding()

    def result(self) -> tuple[bool, Decision | None]:
        """Return the decision."""
        return True, self._decision

    def end(self) -> None:
        """Do nothing: no decision is pending."""


class InThread:
    """A planner in a thread beside the drive; its compiled code releases the interpreter lock."""

    def __init__(self) -> None:
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="planning")
        self._future: Future[Decision | None] | None = None
        self._took: deque[float] = deque(maxlen=REMEMBERED)

    @property
    def seconds(self) -> float:
        """Duration of a decision on this computer at its present load [s]."""
        return SPARE * max(self._took, default=0.0)

    def begin(self, deciding: Deciding) -> None:
        """Begin to decide."""
        self._future = self._pool.submit(self._timed, deciding)

    def _timed(self, deciding: Deciding) -> Decision | None:
        began = time.monotonic()
        decision = deciding()
        self._took.append(time.monotonic() - began)
        return decision

    def result(self) -> tuple[bool, Decision | None]:
        """Return the decision when it is ready; raise its exception, if any."""
        if self._future is None or not self._future.done():
            return False, None
        return True, self._future.result()

    def end(self) -> None:
        """Wait for the pending decision; no further ones are begun."""
        self._pool.shutdown(cancel_futures=True)


@dataclass(frozen=True)
class Place:
    """Where the robot is: x, y [m], theta [rad], and its speed forward [m/s]."""

    x: float
    y: float
    theta: float
    speed: float


@dataclass(frozen=True)
class Shift:
    """Transformation of places into another frame: turned about the origin, then moved by x and y [m]."""

    x: float = 0.0
    y: float = 0.0
    theta: float = 0.0

    @classmethod
    def between(cls, place: Place, same: tuple[float, float, float]) -> "Shift":
        """Return the shift that makes a place the `same` one, x, y [m], theta [rad], in the other frame."""
        turned = cls(theta=same[2] - place.theta).of(place)
        return cls(same[0] - turned.x, same[1] - turned.y, same[2] - place.theta)

    def of(self, place: Place) -> Place:
        """Return the place in the other frame."""
        cosine, sine = math.cos(self.theta), math.sin(self.theta)
        x, y = cosine * place.x - sine * place.y, sine * place.x + cosine * place.y
        return Place(self.x + x, self.y + y, place.theta + self.theta, place.speed)


class Driving:
    """The commands of an investigation. `finished` is set in the end, and `problem` if it ended early.

    `recording` returns the whole recording so far. `note` is the newest sentence for people, `drove` [s] the driving
    time so far. Without poses, decisions contain the robot's place by dead reckoning; the places given here, which
    drift differently, only give the motion since then.
    """

    def __init__(self, investigation: Investigation, recording: Callable[[], Recording], planner: Planner) -> None:
        self.investigation = investigation
        self.decision: Decision | None = None
        self.finished, self.problem, self.note = False, "", ""
        self.movement: Movement | None = None
        self.drove = 0.0
        self._recording, self._planner = recording, planner
        self._planned: Planned | None = None
        self._pauses, self._openings, self._last = 0, 0, 0
        self._late_since: int | None = None  # start [us] of a rest because of a late plan
        self._shift, self._doubt = Shift(), 0.0
        self._place = self._asked_at = Place(0.0, 0.0, 0.0, 0.0)

    def command(self, utime: int, place: Place) -> tuple[float, float]:
        """Return the duties (left, right) at `utime` [us] of a robot at this place."""
        if self.finished:
            return 0.0, 0.0
        self._place = place
        if self._planned is None:
            self._begin(utime, place)
        elif utime - self._last > LOST:
            self._resume(utime, place)
        self._last = utime
        if self._planned is None:
            return 0.0, 0.0
        if self.movement is not None and not self._is_safe(place):
            self._rest(utime, NEAR_THE_BORDER)
        if utime >= self._planned.ends:
            self._go_on(utime)
        return self._duties(utime)

    def end(self) -> None:
        """End the investigation for its report: no further decisions are made."""
        self._planner.end()

    def _begin(self, utime: int, place: Place) -> None:
        movement, why = self.investigation.opening(place.x, place.y, place.theta)
        if why:
            self.finished, self.problem = True, why
            return
        self._drive(movement, utime)

    def _resume(self, utime: int, place: Place) -> None:
        """Go on after an interruption. An opening begins again: the first choices need its data."""
        self.note = INTERRUPTED.format(seconds=(utime - self._last) * SECONDS)
        is_opening = self.movement is not None and self.movement.name == OPENING
        self._break_off(self._last)
        if is_opening and self._openings < MOST_OPENINGS:
            movement, why = self.investigation.opening(place.x, place.y, place.theta)
            if not why:
                self._drive(movement, utime)
                return
        self._rest(utime)

    def _drive(self, movement: Movement, utime: int) -> None:
        self._break_off(utime)
        if self._late_since is not None:
            self.investigation.waited += (utime - self._late_since) * SECONDS
            self._late_since = None
        self._planned, self.movement = Planned.of(movement, utime), movement
        self._openings += movement.name == OPENING
        self.drove += movement.seconds
        if movement.name != OPENING:
            self._plan()

    def _rest(self, utime: int, note: str = "") -> None:
        """Stand still for a while and plan the following movement."""
        self.note = note or self.note
        self._break_off(utime)
        pause = Movement("pause", np.zeros((math.ceil(PAUSE / PERIOD), 2)))
        self._planned = Planned.of(pause, utime)
        self._plan()

    def _break_off(self, utime: int) -> None:
        """End the movement; its undriven rest does not count as driving time."""
        if self.movement is not None and self._planned is not None:
            self.drove -= max(0, self._planned.ends - utime) * SECONDS
        self.movement = None

    def _plan(self) -> None:
        planned, recording, least = self._planned, self._recording(), self._planner.seconds
        assert planned is not None
        self._asked_at = self._place
        self._planner.begin(lambda: self.investigation.decide(recording, planned, least))

    def _go_on(self, utime: int) -> None:
        """Start the movement planned to follow the finished one; if the plan comes too late, plan again from rest."""
        assert self._planned is not None
        there, decision = self._planner.result()
        stands = self.movement is None
        late = not stands and utime - self._planned.ends > 2.0 * PERIOD / SECONDS
        if not there and stands:
            return  # the planner still works
        if self.movement is not None and self.movement.name == OPENING:
            self._drive(waiting(), utime)
            return
        if decision is None or (late and not decision.finished):
            if self._late_since is None and (late or not there):
                self._late_since = utime
            self._rest(utime)
            return
        self.decision = decision
        if decision.reckoned is not None:
            self._shift = Shift.between(self._asked_at, decision.reckoned.place)
            self._doubt = decision.reckoned.doubt
        if decision.finished:
            self.finished = True
            self._planned, self.movement = None, None
        elif decision.choice.movement is None:
            self._pauses += 1
            self.finished = self._pauses > (MOST_PAUSES if decision.reckoned is None else MOST_PAUSES_UNSEEN)
            self.problem = decision.sentence if self.finished else ""
            self._rest(utime, decision.sentence)
        else:
            self._pauses = 0
            self._drive(decision.choice.movement, utime)

    def _is_safe(self, place: Place) -> bool:
        """Return whether the robot, if stopped now, would stay on the floor: half of the margin is for stopping."""
        floor, place = self.investigation.floor, self._shift.of(place)
        ahead = STOPPING * place.speed
        x, y = place.x + ahead * math.cos(place.theta), place.y + ahead * math.sin(place.theta)
        return float(floor.room(np.array(x), np.array(y))) > self._doubt - 0.5 * floor.margin

    def _duties(self, utime: int) -> tuple[float, float]:
        if self._planned is None or utime >= self._planned.ends:
            return 0.0, 0.0
        number = int(np.searchsorted(self._planned.utime, utime, side="right")) - 1
        if number < 0:
            return 0.0, 0.0
        left, right = self._planned.duty[number]
        return float(left), float(right)
