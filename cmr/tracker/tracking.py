"""Convert the data of a tracker to poses of robots at their times of exposure, on this host's clock."""

import select
import time
from collections import Counter, deque
from typing import NamedTuple

from cmr.bus.clock_map import ClockMap
from cmr.tracker.frames import Plane, Sample
from cmr.tracker.profile import Profile
from cmr.tracker.source import Clock, Source
from cmr.tracker.supervisor import Supervisor, Trouble

TEND_PERIOD = 0.1  # s
SILENT = 0.25  # s without a sample after which the tracker is reported
IDLE = 0.01  # s between two attempts while the tracker is not connected
NAMED = 8  # robots in a sentence
OLDEST = 0.5  # s from the exposure; older poses are discarded


class Placed(NamedTuple):
    """A robot's pose [m, rad; world] at its time of exposure [us]."""

    utime: int
    robot_id: int
    x: float
    y: float
    theta: float


class Tracking:
    """A tracker, and the processing of its samples."""

    def __init__(
        self, profile: Profile, source: Source, clock: Clock = time.monotonic_ns, day: Clock = time.time_ns
    ) -> None:
        self.source, self._now, self._day = source, clock, day
        self.supervisor = Supervisor(profile)
        self.samples = self.bodies_seen = 0
        self.refused: Counter[str] = Counter()  # samples
        self._lag = profile.tracker.lag
        self._plane = Plane(profile)
        self._clock = ClockMap()
        self._heard = clock() / 1e9
        self._tended = -1e9
        self._latencies: deque[float] = deque(maxlen=2000)  # s from the arrival to the poses
        self._bodies: tuple[str, ...] = ()
        self._wanted = {carried.body for carried in profile.robots.values()}

    def wait(self, seconds: float) -> bool:
        """Wait at most this long for a sample; return whether something arrived."""
        now = self._now() / 1e9
        if now - self._tended >= TEND_PERIOD:
            self._tended = now
            self.source.tend(now)
        filenos = self.source.filenos()
        if not filenos:
            time.sleep(min(max(seconds, 0.0), IDLE))
            return False
        return bool(select.select(filenos, [], [], max(seconds, 0.0))[0])

    def read(self) -> list[Placed]:
        """Return the poses in the data received."""
        placed = []
        offset = self._day() - self._now()  # each time, since the wall clock may be set
        for sample in self.source.read():
            placed += self.take(sample, offset)
        return placed

    def take(self, sample: Sample, offset: int) -> list[Placed]:
        """Return the poses in a sample; `offset` [ns] converts from the monotonic clock to wall-clock time."""
        self.samples += 1
        self.bodies_seen += len(sample.names)
        self._heard = sample.arrival / 1e9
        self._bodies = sample.names
        exposed = self._exposed(sample)
        if exposed is None:
            return []
        poses = self._plane.poses(sample)
        utime = round((exposed - self._lag) * 1e6) + offset // 1000
        passed = self.supervisor.take(utime / 1e6, poses, self._plane.wrong)
        return [Placed(utime, pose.robot_id, pose.x, pose.y, pose.theta) for pose in passed]

    def note_latency(self) -> None:
        """Record that the poses of the last sample have been passed on."""
        self._latencies.append(self._now() / 1e9 - self._heard)

    def _exposed(self, sample: Sample) -> float | None:
        """Return when a sample was exposed, on the monotonic clock [s]; None if that is not known accurately enough."""
        arrival = sample.arrival / 1e9
        if sample.measured is None or sample.sent is None:
            return arrival
        if not self._clock.add(sample.sent, arrival):
            self.refused["the tracker's clock was set"] += 1
            self.supervisor.begin_anew()
        if not self._clock.is_known:
            self.refused["clock not known yet"] += 1
            return None
        exposed = min(self._clock.here(sample.measured), arrival)
        if arrival - exposed > OLDEST:
            self.refused["too old"] += 1
            return None
        return exposed

    def problem(self, now: float) -> str:
        """Return the problems, in sentences; empty if there are none."""
        silent = now - self._heard
        if silent > SILENT:
            return f"{self.source.problem} No frame from the tracker for {silent:.1f} s.".strip()
        troubles = self.supervisor.troubles(self._day() / 1e9)
        return f"{self.source.problem} {_sentence(troubles, with_times=True)}".strip()

    def headline(self) -> str:
        """Return the problems without times, which change."""
        if self._now() / 1e9 - self._heard > SILENT:
            return self.source.problem or "No frames from the tracker."
        return f"{self.source.problem} {_sentence(self.supervisor.troubles(self._day() / 1e9))}".strip()

    def troubled(self) -> frozenset[str]:
        """Return the problems in a form that changes only when one appears or ends."""
        silent = self._now() / 1e9 - self._heard > SILENT
        troubles = [] if silent else self.supervisor.troubles(self._day() / 1e9)
        return frozenset([str(silent), self.source.problem, *(f"{one.robot_id} {one.why}" for one in troubles)])

    def summary(self, seconds: float) -> str:
        """Return which robots and bodies are seen, the accuracy of stamps, and what was withheld, in sentences."""
        missing = sorted(self._wanted - set(self._bodies))
        rate = self.samples / seconds if seconds > 0.0 else 0.0
        self.samples = 0
        sentences = [f"{rate:.0f} frames/s with {len(self._bodies)} bodies, {len(self._wanted)} of them robots'."]
        if missing:
            sentences.append(f"Not in the last frame: {', '.join(missing[:NAMED])}.")
        if self._clock.is_known:
            sentences.append(f"Stamps: +-{self._clock.spread * 1e3:.2f} ms, and {self.source.uncertainty}.")
        if self._latencies:
            ordered = sorted(self._latencies)
            sentences.append(f"Latency: 99 % within {ordered[int(0.99 * (len(ordered) - 1))] * 1e3:.1f} ms.")
        withheld = {**self.supervisor.withheld, **self.refused}
        if withheld:
            worst = sorted(withheld.items(), key=lambda one: -one[1])[:6]
            sentences.append(f"Withheld: {', '.join(f'{why} {count}' for why, count in worst)}.")
        return " ".join(sentences)


def _sentence(troubles: list[Trouble], *, with_times: bool = False) -> str:
    """Return which robots have no poses, why, and optionally for how long."""
    said = [
        f"robot {trouble.robot_id} {trouble.why}"
        + (f" ({trouble.seconds:.1f} s)" if with_times and trouble.seconds is not None else "")
        for trouble in troubles[:NAMED]
    ]
    more = f", and {len(troubles) - NAMED} more" if len(troubles) > NAMED else ""
    return f"No poses: {'; '.join(said)}{more}." if said else ""
