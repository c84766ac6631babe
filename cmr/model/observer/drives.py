"""Recorded drives joined for the compiled observer: one call for all pieces of a recording."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from cmr.model.commands import PROFILE, fill_profiles

if TYPE_CHECKING:
    from cmr.model.observer.observer import Observations

S = TypeVar("S", bound=np.generic)
Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
MOST_PROFILES = 16  # cached: candidates mostly share a few delays


@dataclass(frozen=True)
class Ends:
    """The ends of each of K drives in joined arrays, shape (K + 1,), starting with 0."""

    steps: Indices
    wheel: Indices
    gyro: Indices
    pose: Indices
    given: Indices
    commands: Indices


@dataclass(frozen=True)
class Drives:
    """Commands and sensor readings of K drives, one after another.

    Times of readings and commands [s] count from the beginning of their own drive. `start` (K, 7) is x, y, theta,
    psi_left, psi_right and the wheel rotations there [rad], `began` (K,) [s] the time since the robot set off; the
    other arrays are those of `Observations`, and `ends` are the ends of each drive's rows. A `continued` (K,) drive
    follows the previous one after a gap: lasting memory, such as the battery's charge, is kept.
    """

    dt: float
    start: Floats
    began: Floats
    continued: NDArray[np.uint8]
    ends: Ends
    wheel_time: Floats
    wheel: Floats
    wheel_use: NDArray[np.uint8]
    gyro_time: Floats
    gyro: Floats
    pose_time: Floats
    pose: Floats
    pose_use: NDArray[np.uint8]
    given: Floats
    command_time: Floats
    command_duty: Floats
    _profiles: dict[float, Floats] = field(default_factory=dict, repr=False)

    @classmethod
    def of(cls, observations: Sequence["Observations"], continued: Sequence[bool] = ()) -> "Drives":
        """Join drives with equal steps; without `continued` they are independent.

        Raises ValueError if the steps differ, or without any drive.
        """
        steps = {one.dt for one in observations}
        if len(steps) != 1:
            raise ValueError(f"drives observed together need one and the same step; these have {sorted(steps)}")

        return cls(
            dt=steps.pop(),
            start=np.array([(*one.start, *one.turned) for one in observations], np.float64),
            began=np.array([one.time for one in observations], np.float64),
            continued=np.array(continued or [False] * len(observations), np.uint8),
            ends=Ends(
                steps=ends_of([one.steps for one in observations]),
                wheel=ends_of([len(one.wheel_time) for one in observations]),
                gyro=ends_of([len(one.gyro_time) for one in observations]),
                pose=ends_of([len(one.pose_time) for one in observations]),
                given=ends_of([len(one.given) for one in observations]),
                commands=ends_of([len(one.commands.time) for one in observations]),
            ),
            wheel_time=_joined([one.wheel_time for one in observations]),
            wheel=_joined([one.wheel for one in observations]),
            wheel_use=_joined([one.wheel_use for one in observations]),
            gyro_time=_joined([one.gyro_time for one in observations]),
            gyro=_joined([one.gyro for one in observations]),
            pose_time=_joined([one.pose_time for one in observations]),
            pose=_joined([one.pose for one in observations]),
            pose_use=_joined([one.pose_use for one in observations]),
            given=_joined([one.given for one in observations]),
            command_time=_joined([one.commands.time for one in observations]),
            command_duty=_joined([one.commands.duty for one in observations]),
        )

    @property
    def steps(self) -> int:
        """The number of steps of all drives."""
        return int(self.ends.steps[-1])

    def profile(self, delay: float) -> Floats:
        """Return the duties in each step of all drives, (steps, 5), with commands delayed by `delay` [s].

        Columns are those of `cmr.model.commands`. The result is cached and read-only.
        """
        known = self._profiles.get(delay)
        if known is None:
            known = np.zeros((self.steps, len(PROFILE)))
            fill_profiles(
                self.command_time, self.command_duty, self.ends.commands, self.dt, delay, self.ends.steps, known
            )
            if len(self._profiles) >= MOST_PROFILES:
                self._profiles.pop(next(iter(self._profiles)))
            self._profiles[delay] = known
        return known


def ends_of(counts: Sequence[int] | Indices) -> Indices:
    """Return the ends of K parts, (K + 1,), starting with 0."""
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)


def _joined(arrays: Sequence[NDArray[S]]) -> NDArray[S]:
    """Return the rows of all arrays in one, which compiled functions take."""
    return np.ascontiguousarray(arrays[0] if len(arrays) == 1 else np.concatenate(arrays))
