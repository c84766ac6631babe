"""Decide whether a drive is sufficient for a calibration, and what is missing.

Both lobes of a figure-eight, both directions of turn: time is counted in buckets by what the wheels do, and each bucket
must reach its minimum. Only wheel speeds are used (or duties without wheel data), as the ratio of turning to driving,
so no parameter of the robot needs to be known.

A drive at one speed is enough, but one at two is more informative: `only_speed` returns the speed if there is only one.
"""

from dataclasses import dataclass

import numpy as np

from cmr.recordings.signal import Floats

MOVING = 0.02  # sum of both sides' duty, or of wheel speeds as a share of the fastest seen; below it the robot rests
TURNING = 0.05  # |right - left| / (|left| + |right|); a lobe of three base widths' radius has 0.17
LONGEST_SAMPLE = 0.1  # s; a gap in the data does not count as driving
SLOWEST_SPEED = 0.5  # rad/s; the fastest speed seen counts as at least this, so that encoder noise is not motion
SPAN = 0.5  # s over which speeds are averaged; over less, encoder quantisation would look like different speeds
RESTING = 0.1  # of the usual speed
SLOW, FAST = 20.0, 80.0  # percentiles of the speeds while the robot moves
ONE_SPEED = 1.6  # ratio of a drive's fast and slow speeds below which it has one speed
SLOWER, FASTER = 0.4, 2.5  # second speeds, as multiples of the first
BRISK = 0.35  # m/s; a robot this fast is asked to drive slower next, otherwise faster


def only_speed(speeds: Floats) -> float | None:
    """Return the speed of a drive that has only one, in the unit of `speeds` (n,), all non-negative; otherwise None.

    A robot that only turned on the spot has none.
    """
    usual = float(np.median(speeds)) if len(speeds) else 0.0
    if usual <= 0.0:
        return None
    moving = speeds[speeds > RESTING * usual]
    slow, fast = np.percentile(moving, (SLOW, FAST))
    return float(np.median(moving)) if fast < ONE_SPEED * slow else None


def second_speed(speed: float) -> float:
    """Return the speed [m/s] for a useful further drive after one at `speed` [m/s]."""
    return (SLOWER if speed > BRISK else FASTER) * speed


@dataclass(frozen=True)
class Bucket:
    """A kind of motion and the time [s] of it that a calibration needs."""

    name: str
    seconds: float


LEFT = Bucket("turning left", 4.0)
RIGHT = Bucket("turning right", 4.0)
MOVING_AT_ALL = Bucket("moving", 12.0)
BUCKETS = (LEFT, RIGHT, MOVING_AT_ALL)


class Coverage:
    """Time seen in each bucket; add the wheel speeds (or duties) in order."""

    def __init__(self) -> None:
        self.seconds = dict.fromkeys(BUCKETS, 0.0)
        self._last_utime: int | None = None
        self._fastest = SLOWEST_SPEED
        self._speeds: list[float] = []
        self._way, self._time = 0.0, 0.0  # driven, and for how long [s], since the last of the speeds

    def add(self, utime: int, left: float, right: float) -> bool:
        """Count one sample; return whether the robot moves. One older than the last adds no time."""
        total = abs(left) + abs(right)
        self._fastest = max(self._fastest, total)
        moving = total > MOVING * self._fastest
        dt = 0.0 if self._last_utime is None else min(max(utime - self._last_utime, 0) * 1e-6, LONGEST_SAMPLE)
        self._last_utime = max(utime, self._last_utime or 0)
        if moving:
            self.seconds[MOVING_AT_ALL] += dt
            self._add_speed(abs(left + right) / 2.0, dt)
            ratio = (right - left) / total
            if abs(ratio) > TURNING:
                self.seconds[LEFT if ratio > 0.0 else RIGHT] += dt
        return moving

    def _add_speed(self, speed: float, dt: float) -> None:
        self._way, self._time = self._way + speed * dt, self._time + dt
        if self._time >= SPAN:
            self._speeds.append(self._way / self._time)
            self._way, self._time = 0.0, 0.0

    @property
    def only_speed(self) -> float | None:
        """The common speed of both wheels [rad/s, or duty] if there was only one so far, otherwise None."""
        return only_speed(np.array(self._speeds))

    @property
    def complete(self) -> bool:
        """Whether every bucket has its minimum."""
        return self.exceeds(1.0)

    def exceeds(self, times: float) -> bool:
        """Whether every bucket has `times` its minimum."""
        return all(seconds >= times * bucket.seconds for bucket, seconds in self.seconds.items())

    @property
    def progress(self) -> float:
        """The share of the required time so far, 0 to 1, averaged over the buckets."""
        return sum(min(seconds / bucket.seconds, 1.0) for bucket, seconds in self.seconds.items()) / len(BUCKETS)

    @property
    def missing(self) -> str:
        """What is still missing, as text; empty if nothing is."""
        lacking = [(bucket.name, bucket.seconds - seconds) for bucket, seconds in self.seconds.items()]
        return ", ".join(f"{name} for {seconds:.1f} s more" for name, seconds in lacking if seconds > 0.0)
