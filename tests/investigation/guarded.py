"""Drives of the floor guard alone: movements at random, checked before they are driven, by robots not quite known.

Of a dozen movements that keep to the floor as predicted, the one that leads nearest to its border is driven.
"""

import zlib
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, cast

import numpy as np

from cmr.investigation.choosing import SLOWER, UNEQUAL, keeps_to
from cmr.investigation.driving import AtOnce, Driving, Place
from cmr.investigation.engine import Planned
from cmr.investigation.floor import Floor
from cmr.investigation.movements import PERIOD, Movement, candidates, towards
from cmr.investigation.prediction import Situation, paths
from cmr.model.commands import Commands
from cmr.plant.parameters import Floats
from cmr.recordings.recording import Recording
from cmr.recordings.signal import SECONDS
from tests.hidden_effects.robots import draw_robot
from tests.hidden_effects.sizes import draw_sizes
from tests.investigation.investigated import L_SHAPE, REST, SMALL, SQUARE, UNLIMITED, DrivenRobot, within
from tests.reference_plant import TYPICAL
from tests.reference_plant.drives import utime

FLOORS = (SQUARE, SMALL, L_SHAPE)
DRIVE = 20.0  # s
OFF = 0.02  # share by which parameters are off that an opening has made known
AT_ONCE = 12  # movements that are looked at, until some keep to the floor
BY_CHANCE = ("command_jitter", "command_loss", "wheel_separation_error", "pose_smoothing", "wheel_speed_latency")
EFFECTS = tuple(name for name in TYPICAL if name not in BY_CHANCE)


@dataclass(frozen=True)
class Guarded:
    """What came of a drive: the `effect` that nobody knew of, how far [m] it kept `within` the floor, `movements`."""

    effect: str
    seconds: float
    within: float
    movements: int


def guarded(seed: int) -> Guarded:
    """Drive a robot with an effect of usual size that the guard does not know, on a floor of three, at random."""
    random = np.random.default_rng([seed, zlib.crc32(b"guard")])
    robot = draw_robot(random)
    effect = str(random.choice(EFFECTS))
    floor = Floor(FLOORS[seed % len(FLOORS)])
    hidden = draw_sizes(effect, robot, DRIVE, random)
    driven = DrivenRobot({**robot, **hidden}, seed=seed, pose=(*floor.middle, random.uniform(-np.pi, np.pi)))
    believed = {name: value * (1.0 + random.uniform(-OFF, OFF)) for name, value in robot.items()}
    guard = _Guard(driven, {**believed, "wheel_radius": robot["wheel_radius"]}, floor, random)
    driving = Driving(cast(Any, guard), lambda: cast(Recording, None), AtOnce())
    driven.drive(0.0, 0.0, REST)
    while driven.time < DRIVE and not driving.finished:
        left, right = driving.command(int(utime(np.array([driven.time]))[0]), _place(driven))
        driven.drive(left, right, PERIOD)
    for _ in range(50):
        driven.drive(0.0, 0.0, PERIOD)
    return Guarded(effect, round(driven.time, 2), within(driven.path, floor), guard.chosen)


def _place(driven: DrivenRobot) -> Place:
    """Return where a robot is, and how fast, as the world's estimate has it."""
    state = driven.state
    speed = 0.5 * driven.parameters.wheel_radius * (state["psi_left"] + state["psi_right"])
    return Place(state["x"], state["y"], state["theta"], speed)


class _Guard:
    """An investigation that draws movements until some keep to the floor, and chooses the one nearest to its border."""

    longest = DRIVE

    def __init__(
        self, driven: DrivenRobot, believed: dict[str, float], floor: Floor, random: np.random.Generator
    ) -> None:
        self.floor, self.waited, self.chosen = floor, 0.0, 0
        self._driven, self._random = driven, random
        slower = {**believed, "k1": SLOWER * believed["k1"]}
        self._robots = [believed, *({**slower, "motor_gain_asymmetry": one} for one in (-UNEQUAL, UNEQUAL))]

    def opening(self, *_place: float) -> tuple[Movement, str]:
        """Rest for a moment."""
        return Movement("rest", np.zeros((10, 2))), ""

    def decide(self, _recording: Recording, planned: Planned, _least: float) -> SimpleNamespace:
        """Choose a movement that keeps to the floor."""
        movement = self._movement(self._situation(planned))
        self.chosen += movement is not None
        choice = SimpleNamespace(movement=movement)
        return SimpleNamespace(choice=choice, finished=False, sentence="", reckoned=None)

    def _movement(self, situation: Situation) -> Movement | None:
        x, y, *_ = situation.state
        away = max(float(np.hypot(self.floor.middle[0] - x, self.floor.middle[1] - y)), 0.1)
        best = self._robots[0]
        back = towards(away, best["wheel_radius"] / best["k1"], self._random)
        drawn = [*candidates(self._random, 3 * AT_ONCE), *back]
        for first in range(0, len(drawn), AT_ONCE):
            some = drawn[first : first + AT_ONCE]
            foreseen = zip(some, paths(situation, some, self._robots), strict=True)
            kept = [(within(path, self.floor), movement) for movement, path in foreseen if keeps_to(self.floor, path)]
            if kept:
                return min(kept, key=lambda one: one[0])[1]
        return None

    def _situation(self, planned: Planned) -> Situation:
        state, now = self._driven.state, int(utime(np.array([self._driven.time]))[0])
        to_come = planned.utime >= now
        moments: Floats = np.asarray((planned.utime[to_come] - now) * SECONDS, np.float64)
        speeds = state["psi_left"], state["psi_right"]
        return Situation(
            state=(state["x"], state["y"], state["theta"], *speeds),
            time=self._driven.time,
            turned=(state["phi_left"], state["phi_right"]),
            commands=_after_rest(moments, planned.duty[to_come]),
            busy=max(0.0, (planned.ends - now) * SECONDS),
            energy=0.0,
            heat=0.0,
            limits=UNLIMITED,
            intervals=(None, None, None),
        )


def _after_rest(time: Floats, duty: Floats) -> Commands:
    """Return commands at `time` [s], (n,), of `duty` (n, 2), after one of no duty that was under way already."""
    return Commands(np.concatenate([[-SECONDS], time]), np.concatenate([np.zeros((1, 2)), duty]))
