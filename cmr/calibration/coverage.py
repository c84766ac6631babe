"""Tell whether a drive holds what a calibration needs, and if not, what is missing.

Both lobes of a figure-eight, both directions of turn: time is counted in buckets by what the wheels do, and each
bucket must reach its minimum. Only wheel speeds are looked at (duties, where no wheels are measured), as the ratio
of turning to driving, so that no parameter of the robot need be known beforehand.
"""

from dataclasses import dataclass

MOVING = 0.02  # sum of both sides' duty, or of wheel speeds as a share of the fastest seen; below it the robot rests
TURNING = 0.05  # |right - left| / (|left| + |right|); a lobe of three base widths' radius has 0.17
LONGEST_SAMPLE = 0.1  # s; a gap in the data does not count as driving
SLOWEST_SPEED = 0.5  # rad/s; the fastest speed seen counts as at least this, so that encoder noise is not motion


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
    """Time seen in each bucket; feed it the wheel speeds (or duties) in the order in which they were measured."""

    def __init__(self) -> None:
        self.seconds = dict.fromkeys(BUCKETS, 0.0)
        self._last_utime: int | None = None
        self._fastest = SLOWEST_SPEED

    def add(self, utime: int, left: float, right: float) -> bool:
        """Count one sample; tell whether the robot moves in it. One older than the last adds no time."""
        total = abs(left) + abs(right)
        self._fastest = max(self._fastest, total)
        moving = total > MOVING * self._fastest
        dt = 0.0 if self._last_utime is None else min(max(utime - self._last_utime, 0) * 1e-6, LONGEST_SAMPLE)
        self._last_utime = max(utime, self._last_utime or 0)
        if moving:
            self.seconds[MOVING_AT_ALL] += dt
            ratio = (right - left) / total
            if abs(ratio) > TURNING:
                self.seconds[LEFT if ratio > 0.0 else RIGHT] += dt
        return moving

    @property
    def complete(self) -> bool:
        """Whether every bucket has its minimum."""
        return self.exceeds(1.0)

    def exceeds(self, times: float) -> bool:
        """Whether every bucket has `times` its minimum."""
        return all(seconds >= times * bucket.seconds for bucket, seconds in self.seconds.items())

    @property
    def progress(self) -> float:
        """Share of the needed time that has been seen, 0 to 1, averaged over the buckets."""
        return sum(min(seconds / bucket.seconds, 1.0) for bucket, seconds in self.seconds.items()) / len(BUCKETS)

    @property
    def missing(self) -> str:
        """What is still missing, for a person; empty when nothing is."""
        lacking = [(bucket.name, bucket.seconds - seconds) for bucket, seconds in self.seconds.items()]
        return ", ".join(f"{name} for {seconds:.1f} s more" for name, seconds in lacking if seconds > 0.0)
