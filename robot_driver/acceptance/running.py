"""Common resources of all steps: the bench, the person, the pace, and the findings."""

import time
from collections.abc import Callable, Collection
from dataclasses import dataclass, field, replace

from cmr.msg import motor_feedback_t
from robot_driver.acceptance.bench import Bench, Duty, Ended
from robot_driver.acceptance.filter import SECOND, Faults, Filter, GyroFaults
from robot_driver.acceptance.findings import Finding, milliseconds
from robot_driver.acceptance.held_up import HeldUp
from robot_driver.acceptance.judges import steady_constant
from robot_driver.acceptance.record import Span
from robot_driver.guided import Guide, Motion

WAVE = 1.6  # s; period of a duty that varies, so that values are distinguishable
LEAST = 0.6  # of the largest duty
RIGHT = 0.9  # of the left duty, so that the sides are distinguishable
RATE = 50.0  # Hz at which the driver serves the motors: that of promise 2
ACCELERATION = 0.5  # duty/s; slow enough to detect a jump at such a small duty
SETTLING = 1.2  # s; a report on PROCESS_STATUS comes each second
ATTEMPTS = 3  # tries of a step on a delayed computer
AT_SPEED = 0.8  # s after which wheels have reached the speed of a duty
NEVER = Span(0, 0)
BY_KEY = "Ended by a key; the motors were stopped. Nothing of the step that it ended counts."


@dataclass(frozen=True)
class Pace:
    """Durations (s). The short pace is for a first look and for tests."""

    steady: float = 600.0
    faulty: float = 60.0
    brief: float = 5.0

    @property
    def is_short(self) -> bool:
        """Whether this is the short form."""
        return self.steady < 600.0


SHORT = Pace(3.0, 4.0, 1.5)
LONG = Pace()


@dataclass
class Run:
    """A run of the protocol. `wanted` are the promises to test; with `hands` somebody can pull cables.

    It is the bench's `look`: while a motion is shown, any key ends the protocol.
    """

    bench: Bench
    guide: Guide
    pace: Pace
    wanted: Collection[int]
    hands: bool
    held_up: HeldUp
    findings: list[Finding] = field(default_factory=list)
    figures: dict[str, float] = field(default_factory=dict)
    constant: tuple[int, int] | None = None  # offset of ticks from the truth on the wire
    good: Span = NEVER  # a span of good driving, for comparison
    turns: bool = False  # whether the wheels turn with this duty
    repeated: int = 0  # steps repeated because this computer was delayed
    _motion: Motion | None = None
    _began: float = 0.0

    @property
    def line(self) -> Filter:
        """The filter in front of the controller."""
        assert self.bench.filter is not None
        return self.bench.filter

    def attempt(self, step: Callable[["Run"], object]) -> None:
        """Make a step; repeat it up to ATTEMPTS times if something failed while this computer was delayed."""
        for number in range(ATTEMPTS):
            before, begun = len(self.findings), time.monotonic_ns()
            step(self)
            failed = any(one.passed is False for one in self.findings[before:])
            held_up = self.held_up.longest(Span(begun, time.monotonic_ns()))
            if not failed or not held_up:
                return
            if number + 1 < ATTEMPTS and self.serves():
                self.repeated += 1
                del self.findings[before:]
            else:
                note = f" (this computer was held up for {milliseconds(held_up)} meanwhile)"
                self.findings[before:] = [replace(one, said=one.said + note) for one in self.findings[before:]]
                return

    def serves(self) -> bool:
        """Return whether the driver, if one was started, is still there."""
        process = self.bench.process
        return process is None or process.poll() is None

    def look(self) -> None:
        """End the protocol if a key was pressed while something moves. Raises Ended."""
        if self._motion is not None:
            self._motion.ended(time.monotonic() - self._began)
            if self._motion.by_person:
                raise Ended(BY_KEY)

    def note(self, *findings: Finding) -> None:
        """Record findings about promises to be tested."""
        self.findings += [finding for finding in findings if finding.promise in self.wanted]

    def wants(self, *promises: int) -> bool:
        """Return whether one of these promises is to be tested."""
        return any(promise in self.wanted for promise in promises)

    def wave(self, elapsed: float) -> Duty:
        """Return a varying duty, forward."""
        share = abs(2.0 * (elapsed / WAVE % 1.0) - 1.0)
        duty = self.bench.setup.duty * (LEAST + (1.0 - LEAST) * share)
        return duty, RIGHT * duty

    def back(self, elapsed: float) -> Duty:
        """Return the same duty, backward."""
        left, right = self.wave(elapsed)
        return -left, -right

    def zero(self, _elapsed: float) -> Duty:
        """Return no duty."""
        return 0.0, 0.0

    def moving(
        self,
        name: str,
        text: str,
        seconds: float,
        duty: Callable[[float], Duty] | None = None,
        until: Callable[[], object] = lambda: False,
    ) -> Span:
        """Announce a motion, and drive."""
        with self.guide.motion(name, text, seconds) as self._motion:
            self._began = time.monotonic()
            try:
                return self.bench.go_on(seconds, duty or self.wave, until)
            finally:
                self._motion = None

    def still(self, seconds: float, duty: Callable[[float], Duty] | None = None) -> Span:
        """Let time pass without any expected motion."""
        return self.bench.go_on(seconds, duty)

    def restore(self) -> None:
        """Restore the line, and wait until the driver is ready."""
        self.line.faults = Faults()
        if self.bench.gyro is not None:
            self.bench.gyro.faults = GyroFaults()
        self.bench.until_served()

    def drives(self, promise: int, check: str) -> bool:
        """Drive until the wheels turn, recording a failed check otherwise; return whether they do."""
        if self.drive_until_moving():
            return True
        process = self.bench.process
        ended = process is None or process.poll() is not None
        said = "the driver has ended" if ended else "the motors were not driven, though a duty was commanded"
        self.note(Finding(promise, check, False, said))
        return False

    def drive_until_moving(self) -> bool:
        """Drive until the wheels turn, for two seconds at most; return whether they did."""
        begin = time.monotonic_ns()
        self.moving("drive", "Driving.", 2.0 + AT_SPEED, until=lambda: self._turned_since(begin))
        return bool(self._turned_since(begin))

    def _turned_since(self, begin: int) -> object:
        """Return whether the wheels have turned for long enough to reach the speed of the duty."""
        now, record = time.monotonic_ns(), self.bench.record
        recent = [
            one for one in record.feedback[-60:] if record.moment(one.utime) > max(begin, now - AT_SPEED * SECOND)
        ]
        return now - begin > 1.25 * AT_SPEED * SECOND and len(recent) > 5 and all(map(_turns, recent))

    def settle_constant(self, span: Span) -> None:
        """Determine the offset of published ticks from the truth in a span."""
        self.constant = steady_constant(self.bench.record, self.bench.wire(), span)


def _turns(one: motor_feedback_t) -> bool:
    return bool(one.applied_left) and abs(one.psi_left) + abs(one.psi_right) > 0.0
