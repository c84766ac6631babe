"""Robots that drive figures beside one another, and what a tracker that goes wrong makes of them."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tests.support.trackers.frame import Body

Floats = NDArray[np.float64]
SPACING = 1.2  # m between the figures' centres
NOISE, TURN_NOISE = 0.0001, 0.0005  # m, rad: standard deviations of an optical tracker
COLUMNS = 10


class Robots:
    """Robots by number; each drives a figure eight of its own size, pace and place."""

    def __init__(self, count: int, seed: int = 0, spacing: float = SPACING) -> None:
        random = np.random.default_rng(seed)
        self.count, self._spacing = count, spacing
        self._pace = random.uniform(0.7, 1.3, count)  # rad/s
        self._phase = random.uniform(0.0, 2.0 * math.pi, count)
        self._size = random.uniform(0.35, 0.45, count)  # m

    def all_at(self, t: "float | Floats") -> Floats:
        """Return where all robots are at a time [s], or at a time for each of them: x, y, theta, shape (3, n)."""
        a = self._pace * t + self._phase
        row, column = np.divmod(np.arange(self.count), COLUMNS)
        x = column * self._spacing + self._size * np.sin(a)
        y = row * self._spacing + self._size * np.sin(2.0 * a) / 2.0
        return np.array([x, y, np.arctan2(self._size * np.cos(2.0 * a), self._size * np.cos(a))])

    def at(self, number: int, t: float) -> tuple[float, float, float]:
        """Return where a robot is [m, rad] at a time [s]."""
        a = self._pace[number] * t + self._phase[number]
        row, column = divmod(number, COLUMNS)
        size = self._size[number]
        x, y = column * self._spacing + size * math.sin(a), row * self._spacing + size * math.sin(2.0 * a) / 2.0
        return x, y, math.atan2(size * math.cos(2.0 * a), size * math.cos(a))


Bodies = list[Body]


@dataclass(frozen=True)
class Fault:
    """What a tracker does wrong from `begin` to `end` [s].

    `change(bodies, t, random)` makes wrong bodies of right ones. Frames are left out with `silent`, come in another
    order with `shuffled`, and a second tracker sends what `second` makes of them.
    """

    name: str
    begin: float = 4.0
    end: float = 6.0
    change: Callable[[Bodies, float, np.random.Generator], Bodies] | None = None
    silent: bool = False
    shuffled: bool = False
    second: Callable[[Bodies], Bodies] | None = None

    def is_on(self, t: float) -> bool:
        """Return whether it is going wrong."""
        return self.begin <= t < self.end


def faults() -> list[Fault]:
    """Return each kind of misbehaviour once; each call begins with an empty memory."""
    return [
        Fault("lost", change=_lost),
        Fault("frozen", change=_Frozen(), end=7.0),
        Fault("swapped", change=_swapped),
        Fault("flipped", change=_flipped),
        Fault("jumps", change=_Jumps()),
        Fault("outliers", change=_outliers),
        Fault("out of order", shuffled=True),
        Fault("two trackers", second=_beside),
        Fault("outage", silent=True, end=5.0),
    ]


WRONG = (0, 11, 22, 33, 44)  # bodies that go wrong, where not all do
PAIRS = ((0, 1), (11, 21), (33, 34))


def measured(robots: Robots, t: float, random: np.random.Generator) -> Bodies:
    """Return what a good tracker measures."""
    noise = random.normal(0.0, 1.0, (3, robots.count)) * [[NOISE], [NOISE], [TURN_NOISE]]
    poses = (robots.all_at(t) + noise).T.tolist()
    return [Body(f"robot_{number}", *pose) for number, pose in enumerate(poses)]


def _some(bodies: Bodies, change: Callable[[int, Body], Body]) -> Bodies:
    return [change(number, body) if number in WRONG else body for number, body in enumerate(bodies)]


def _lost(bodies: Bodies, _t: float, _random: np.random.Generator) -> Bodies:
    return _some(bodies, lambda _, body: body._replace(tracked=False))


class _Frozen:
    """The last pose, again and again."""

    def __init__(self) -> None:
        self._kept: dict[int, Body] = {}

    def __call__(self, bodies: Bodies, _t: float, _random: np.random.Generator) -> Bodies:
        return _some(bodies, lambda number, body: self._kept.setdefault(number, body))


def _swapped(bodies: Bodies, _t: float, _random: np.random.Generator) -> Bodies:
    swapped = list(bodies)
    for one, other in PAIRS:
        if other < len(bodies):
            swapped[one] = bodies[other]._replace(name=bodies[one].name)
            swapped[other] = bodies[one]._replace(name=bodies[other].name)
    return swapped


def _flipped(bodies: Bodies, _t: float, _random: np.random.Generator) -> Bodies:
    return _some(bodies, lambda _, body: body._replace(theta=body.theta + math.pi))


class _Jumps:
    """Each body is in another wrong place for 0.4 s, then for as long in another one."""

    def __call__(self, bodies: Bodies, t: float, _random: np.random.Generator) -> Bodies:
        def jumped(number: int, body: Body) -> Body:
            place = np.random.default_rng([number, int(t / 0.4)])
            angle, distance = place.uniform(0.0, 2.0 * math.pi), place.uniform(0.1, 0.8)
            return body._replace(x=body.x + distance * math.cos(angle), y=body.y + distance * math.sin(angle))

        return _some(bodies, jumped)


def _outliers(bodies: Bodies, _t: float, random: np.random.Generator) -> Bodies:
    """One pose in ten is wrong."""
    return _some(
        bodies,
        lambda _, body: body if random.random() > 0.1 else body._replace(x=body.x + random.choice([-1, 1]) * 0.1),
    )


def _beside(bodies: Bodies) -> Bodies:
    """All bodies in the frame of another calibration."""
    return [body._replace(x=body.x + 0.3, y=body.y - 0.2) for body in bodies]
