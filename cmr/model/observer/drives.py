"""Recorded drives joined for the compiled observer: one call for all pieces of a recording."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from cmr.model.commands import PROFILE, fill_profiles
from cmr.model.observer.structures import Ends, Floats, Indices, Readings, Recorded

if TYPE_CHECKING:
    from cmr.model.observer.observer import Observations

S = TypeVar("S", bound=np.generic)
MOST_PROFILES = 16  # cached: candidates mostly share a few delays


@dataclass(frozen=True)
class Drives:
    """Commands and sensor readings of K drives, one after another.

    Times of readings and commands [s] count from the beginning of their own drive. `command_ends` (K + 1,) are the
    ends of each drive's commands.
    """

    dt: float
    recorded: Recorded
    command_time: Floats
    command_duty: Floats
    command_ends: Indices
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
            recorded=_recorded(observations, continued or [False] * len(observations)),
            command_time=_joined([one.commands.time for one in observations]),
            command_duty=_joined([one.commands.duty for one in observations]),
            command_ends=ends_of([len(one.commands.time) for one in observations]),
        )

    @property
    def steps(self) -> int:
        """The number of steps of all drives."""
        return int(self.recorded.ends.steps[-1])

    def profile(self, delay: float) -> Floats:
        """Return the duties in each step of all drives, (steps, 5), with commands delayed by `delay` [s].

        Columns are those of `cmr.model.commands`. The result is cached and read-only.
        """
        known = self._profiles.get(delay)
        if known is None:
            known = np.zeros((self.steps, len(PROFILE)))
            ends = self.recorded.ends.steps
            fill_profiles(self.command_time, self.command_duty, self.command_ends, self.dt, delay, ends, known)
            if len(self._profiles) >= MOST_PROFILES:
                self._profiles.pop(next(iter(self._profiles)))
            self._profiles[delay] = known
        return known


def ends_of(counts: Sequence[int] | Indices) -> Indices:
    """Return the ends of K parts, (K + 1,), starting with 0."""
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)


def _recorded(observations: Sequence["Observations"], continued: Sequence[bool]) -> Recorded:
    """Return the readings of these drives in joined arrays."""
    return Recorded(
        start=np.array([(*one.start, *one.turned) for one in observations], np.float64),
        began=np.array([one.time for one in observations], np.float64),
        continued=np.array(continued, np.uint8),
        ends=Ends(
            steps=ends_of([one.steps for one in observations]),
            wheel=ends_of([len(one.wheel_time) for one in observations]),
            gyro=ends_of([len(one.gyro_time) for one in observations]),
            pose=ends_of([len(one.pose_time) for one in observations]),
            given=ends_of([len(one.given) for one in observations]),
        ),
        readings=Readings(*(_joined([getattr(one, name) for one in observations]) for name in Readings._fields)),
    )


def _joined(arrays: Sequence[NDArray[S]]) -> NDArray[S]:
    """Return the rows of all arrays in one, which compiled functions take."""
    return np.ascontiguousarray(arrays[0] if len(arrays) == 1 else np.concatenate(arrays))
