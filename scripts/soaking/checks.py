"""What must hold of all that a driver publishes, and of all that its motors are driven with, whatever fails meanwhile.

Times are in us since the Unix epoch. What is published is checked as soon as the emulated robot's account of that time
is complete. Each finding is a sentence; none is what a soak is for.
"""

import bisect
import math
import sys
from collections import Counter, defaultdict, deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from soaking.robot import FULL_DUTY, Record

SECOND = 1_000_000  # us
CYCLE = 20_000  # us; at 50 Hz
LARGEST_GAP = 5 * CYCLE  # between two messages, when nothing fails but single packets
LOST_BY_DAMAGE = 2  # turns: a damage costs its own transaction or reading, and at most the next
SLOWING = {("motor", "latency"): 50_000, ("motor", "pieces"): 50_000}  # us that a turn takes while that lasts
RECOVERY = 2_500_000  # us after a fault is over: pauses between attempts of up to 1 s, and two attempts to connect
RECONNECTED = 100_000  # us; after a shorter gap the driver cannot have connected again
TOLD_WITHIN = 500_000  # us from a device's answer to the message that reports it
TELEMETRY_AGE = 5 * SECOND
LONG_WAIT = 10_000  # us for a processor, within one sample
CLOCKS = 5_000  # us by which a message may seem earlier than what it reports
KEPT = 30 * SECOND  # of the robot's account
STOP_WITHIN = 500_000 + CYCLE  # us, from a stop or from the last command to zero duty
WATCHDOG = 500_000  # us without a byte after which the controller stops by itself
LARGEST_STEP = 0.4  # duty from rest: 10 per second over two cycles
LARGEST_SPEED = 200.0  # rad/s
TICKS_PER_TURN = 2048
COUNTER_RANGE = 2**32
STALLS_BEFORE, STALLS_AFTER = SECOND, SECOND // 10  # us around a finding in which stalls of the machine are reported


class Window(NamedTuple):
    """A fault that explains gaps in one stream, with the time after it in which the driver recovers."""

    stream: str
    name: str
    begin: int
    end: int


@dataclass
class Interval:
    """A time in which the motors must stand still, or else must have been driven at least once, and why.

    `stopped` is when what demands the stop happened. `patient`: the driver waits before it stops, so that what is lost
    just then costs time.
    """

    begin: int
    end: int
    still: bool
    why: str
    stopped: int = 0
    patient: bool = False


@dataclass
class Findings:
    """What came out: sentences on what must not be, and figures."""

    wrong: list[str] = field(default_factory=list)
    counts: Counter[str] = field(default_factory=Counter)
    largest: dict[str, float] = field(default_factory=lambda: defaultdict(float))  # s
    stamp_errors: list[int] = field(default_factory=list)  # us
    stalls: deque[tuple[int, int]] = field(default_factory=lambda: deque(maxlen=1000))  # begin and end

    def note_stall(self, begin: int, end: int) -> None:
        """Note that the machine stood still."""
        self.stalls.append((begin, end))
        self.counts["times the machine stood still"] += 1
        key = "the machine stood still"
        self.largest[key] = max(self.largest[key], (end - begin) / SECOND)

    def blame(self, utime: int, text: str) -> None:
        """Note something that must not be, and whether the machine stood still about then; say it at once."""
        near = [
            end - begin for begin, end in self.stalls if begin < utime + STALLS_AFTER and end > utime - STALLS_BEFORE
        ]
        stood = f"stood still {len(near)} times, at most {max(near) / 1000:.0f} ms" if near else "ran"
        self.wrong.append(f"{utime / SECOND:.3f}: {text}; in the second before, the machine {stood}")
        print(f"WRONG {self.wrong[-1]}", file=sys.stderr, flush=True)


class Account:
    """What the emulated robot says was true, as far back as is needed."""

    def __init__(self) -> None:
        self.upto = 0
        self._times: dict[str, deque[int]] = defaultdict(deque)
        self._values: dict[str, deque[Any]] = defaultdict(deque)

    def take(self, record: Record) -> None:
        """Take the next record."""
        if record.kind == "upto":
            self.upto = max(self.upto, record.utime)
            return
        times, values = self._times[record.kind], self._values[record.kind]
        times.append(record.utime)
        values.append(record.value)
        while times[0] < record.utime - KEPT:
            times.popleft()
            values.popleft()

    def between(self, kind: str, begin: int, end: int) -> Iterator[tuple[int, Any]]:
        """Yield (time, value) of the records of a kind from `begin` to `end`."""
        times, values = self._times[kind], self._values[kind]
        first, last = bisect.bisect_left(times, begin), bisect.bisect_right(times, end)
        for index in range(first, last):
            yield times[index], values[index]

    def last_before(self, kind: str, utime: int) -> Any:
        """Return the value of the last record of a kind up to a time, None if there is none."""
        index = bisect.bisect_right(self._times[kind], utime)
        return self._values[kind][index - 1] if index else None


class Gaps:
    """Whether the stamps of one stream increase, and whether each gap between them is explained."""

    def __init__(
        self, stream: str, line: str, period: int, account: Account, waits: "Waits", findings: Findings
    ) -> None:
        self.windows: list[Window] = []
        self.others: list[Window] = []  # faults that do not explain a gap, but may help a person to
        self.last = 0
        self._period = period
        self._stream = stream
        self._line = line
        self._account = account
        self._waits = waits
        self._findings = findings

    def take(self, utime: int) -> int:
        """Take the stamp of the next message; return how long after the last one it is (us)."""
        gap, begin, self.last = utime - self.last if self.last else 0, self.last, utime
        if begin and gap <= 0:
            self._findings.blame(utime, f"{self._stream} is not stamped later than the message before, but {gap} us")
        if gap > LARGEST_GAP:
            self._explain(begin, utime)
        return gap

    def in_window(self, utime: int) -> bool:
        """Return whether a fault, or the recovery from it, explains that this stream is interrupted."""
        return any(window.begin <= utime <= window.end for window in self.windows)

    def _explain(self, begin: int, end: int) -> None:
        gap = end - begin
        damages = sum(self._of_line("damage", begin - CYCLE, end))
        near = [window for window in (*self.windows, *self.others) if window.begin <= end and begin <= window.end]
        turn = max([self._period, *(SLOWING.get((self._line, window.name), 0) for window in near)])
        lates = self._of_line("late", begin - CYCLE, end)
        losses = len(lates) + self._waits.long_ones(begin, end)  # of what was answered, or heard, too late
        waited = self._waits.between(begin, end) + sum(lates) + losses * LOST_BY_DAMAGE * turn
        if any(window.begin <= begin + LARGEST_GAP and end <= window.end for window in self.windows):
            why = "a fault"
        elif gap <= LARGEST_GAP + damages * LOST_BY_DAMAGE * turn:
            why = "damages"
        elif gap <= LARGEST_GAP + damages * LOST_BY_DAMAGE * turn + waited:
            why = "no processor"
        else:
            why = "nothing"
            self._findings.blame(
                end,
                f"{self._stream} paused for {gap / SECOND:.3f} s: {damages} damages, {waited / SECOND:.3f} s held up, "
                f"faults near: {', '.join(window.name for window in near) or 'none'}",
            )
        self._findings.counts[f"{self._stream} gaps above 0.1 s by {why}"] += 1
        key = f"{self._stream} longest gap by {why}"
        self._findings.largest[key] = max(self._findings.largest[key], gap / SECOND)

    def _of_line(self, kind: str, begin: int, end: int) -> list[int]:
        """Return the numbers that go with the records of a kind about the line of this stream."""
        return [number for _, (line, number) in self._account.between(kind, begin, end) if line == self._line]


class Waits:
    """How long the driver, the emulator and the kernel's workers have waited for a processor that others used."""

    def __init__(self) -> None:
        self._times: deque[int] = deque(maxlen=20_000)
        self._totals: deque[int] = deque(maxlen=20_000)

    def take(self, utime: int, total: int) -> None:
        """Take how long they have waited up to now (us)."""
        self._times.append(utime)
        self._totals.append(total)

    def before(self, utime: int) -> int:
        """Return how long they waited in the seconds before a time (us)."""
        return self.between(utime - KEPT // 10, utime)

    def between(self, begin: int, end: int) -> int:
        """Return how long they waited (us); what cannot be distinguished is counted in."""
        return sum(self._each(begin, end))

    def long_ones(self, begin: int, end: int) -> int:
        """Return how often they waited for so long that an answer may have come too late."""
        return sum(wait > LONG_WAIT for wait in self._each(begin, end))

    def _each(self, begin: int, end: int) -> list[int]:
        first = max(bisect.bisect_right(self._times, begin) - 1, 0)
        last = min(bisect.bisect_left(self._times, end), len(self._times) - 1)
        return [self._totals[index + 1] - self._totals[index] for index in range(first, last)]


class MotorChecks:
    """MOTOR_FEEDBACK against what the motor controller answered."""

    def __init__(self, account: Account, gaps: Gaps, waits: Waits, findings: Findings) -> None:
        self._account = account
        self._gaps = gaps
        self._waits = waits
        self._findings = findings
        self._offsets: set[tuple[int, int]] = set()
        self._before: Any = None

    def take(self, message: Any) -> None:
        """Check the next message."""
        begin = self._gaps.last
        gap = self._gaps.take(message.utime)
        self._findings.counts["MOTOR_FEEDBACK"] += 1
        rebased = self._check_counts(message, gap, begin)
        if self._before is not None and not rebased:
            self._check_speed(message, self._before)
        self._before = message
        self._check_others(message)

    def _check_counts(self, message: Any, gap: int, begin: int) -> bool:
        """See that totals differ from the counts answered just now by what they differed by before.

        After a fault they may differ by something else; return whether that is so.
        """
        received = message.received_utime
        recent = received - TOLD_WITHIN - self._waits.before(received), received + CLOCKS
        offsets = {
            ((first - message.ticks_left) % COUNTER_RANGE, (second - message.ticks_right) % COUNTER_RANGE)
            for _, (first, second) in self._account.between("counts", *recent)
        }
        known, self._offsets = self._offsets, offsets
        if not begin or (gap > RECONNECTED and self._gaps.in_window(message.utime)):
            return True
        self._offsets = known & offsets or offsets
        if not known & offsets:
            self._findings.blame(
                message.utime,
                f"ticks {message.ticks_left}, {message.ticks_right} are not what was answered: off by "
                f"{_differences(known, offsets)} after {gap / SECOND:.3f} s",
            )
        return False

    def _check_speed(self, message: Any, before: Any) -> None:
        seconds = (message.utime - before.utime) / SECOND
        for side in ("left", "right"):
            ticks = getattr(message, f"ticks_{side}") - getattr(before, f"ticks_{side}")
            true, stated = ticks * 2 * math.pi / TICKS_PER_TURN / seconds, getattr(message, f"psi_{side}")
            if not (abs(stated) <= LARGEST_SPEED and abs(stated - true) <= 0.05 + 0.02 * abs(true)):
                self._findings.blame(message.utime, f"psi_{side} {stated:.3f} rad/s, but the ticks say {true:.3f}")

    def _check_others(self, message: Any) -> None:
        received = message.received_utime
        stated = {
            "duty": (round(message.applied_left * FULL_DUTY), round(message.applied_right * FULL_DUTY)),
            "battery": (message.battery_voltage,),
            "currents": (message.current_left, message.current_right),
            "temperature": (message.temperature,),
        }
        for kind, values in stated.items():
            true = self._account.between(kind, received - TELEMETRY_AGE, received + CLOCKS)
            if not math.isnan(values[0]) and not any(all(map(math.isclose, values, said)) for _, said in true):
                self._findings.blame(message.utime, f"{kind} {values} is not what was answered")


def _differences(known: set[tuple[int, int]], now: set[tuple[int, int]]) -> str:
    """Return by how many ticks, left and right, reports differ from answers, newest answer first."""
    (left, right), *_ = known or {(0, 0)}
    return ", ".join(f"({left - first}, {right - second})" for first, second in list(now)[-3:]) or "unknown"


class GyroChecks:
    """GYRO against what the gyro sent.

    Where the protocol has no checksum, a value that could be read on the damaged wire cannot be distinguished from a
    true one; those are counted.
    """

    def __init__(self, account: Account, gaps: Gaps, waits: Waits, findings: Findings) -> None:
        self._account = account
        self._gaps = gaps
        self._waits = waits
        self._findings = findings

    def take(self, message: Any) -> None:
        """Check the next message."""
        self._gaps.take(message.utime)
        self._findings.counts["GYRO"] += 1
        if not message.valid:
            self._findings.counts["GYRO reported as not valid"] += 1
            if not math.isnan(message.yaw_rate):
                self._findings.blame(message.utime, "a gyro reading that is not valid has a rate")
            return
        received = message.received_utime
        recent = received - TOLD_WITHIN - self._waits.before(received), received + CLOCKS
        true = [utime for utime, said in self._account.between("rate", *recent) if _is(message, said)]
        if true:
            self._findings.stamp_errors.append(min((message.utime - utime for utime in true), key=abs))
        elif any(_is(message, said) for _, said in self._account.between("misheard", *recent)):
            self._findings.counts["GYRO readings damaged so that nothing shows it"] += 1
        else:
            self._findings.blame(message.utime, f"yaw rate {message.yaw_rate:.6f} rad/s is not what was sent")


def _is(message: Any, said: tuple[float, bool]) -> bool:
    return said[1] and math.isclose(message.yaw_rate, said[0], rel_tol=1e-6, abs_tol=1e-12)


class DriveChecks:
    """What the motors are driven with."""

    def __init__(self, account: Account, gaps: Gaps, waits: Waits, findings: Findings, largest_duty: float) -> None:
        self.intervals: list[Interval] = []
        self.held: list[int] = []  # when the driver said that it waits for zero to be commanded
        self._account = account
        self._gaps = gaps
        self._waits = waits
        self._findings = findings
        self._limit = round(largest_duty * FULL_DUTY) + 1
        self._duty = (0, 0)

    def take(self, record: Record) -> None:
        """Check the next duty."""
        before, self._duty = self._duty, record.value
        if max(map(abs, record.value)) > self._limit:
            self._findings.blame(record.utime, f"duty {record.value} was never commanded")
        for old, new in zip(before, record.value, strict=True):
            if old == 0 and abs(new) > LARGEST_STEP * FULL_DUTY + 1:
                self._findings.blame(record.utime, f"duty jumps from {before} to {record.value}")

    def judge(self) -> None:
        """Check the intervals that the robot's account covers."""
        over = [interval for interval in self.intervals if interval.end < self._account.upto]
        self.intervals = [interval for interval in self.intervals if interval.end >= self._account.upto]
        for interval in over:
            (self._judge_still if interval.still else self._judge_driven)(interval)

    def _judge_still(self, interval: Interval) -> None:
        self._findings.counts[f"stops by {interval.why}"] += 1
        duties = list(self._account.between("duty", interval.stopped, interval.end))
        moving = [utime for utime, duty in duties if any(duty)]
        if moving:
            stood = next((utime for utime, duty in duties if utime > moving[-1] and not any(duty)), interval.end)
            seconds = (stood - interval.stopped) / SECOND
            key = f"longest from {interval.why} to zero duty"
            self._findings.largest[key] = max(self._findings.largest[key], seconds)
        begin = interval.begin + self._lateness(interval)
        if begin >= interval.end:
            return
        before = self._account.last_before("duty", begin)
        if any(before or ()) or any(utime >= begin for utime in moving):
            self._findings.blame(interval.begin, f"the motors were driven after {interval.why}")

    def _lateness(self, interval: Interval) -> int:
        """Return how much later zero may come because packets, the cable or the processor failed just then (us)."""
        if not interval.patient:
            return 0
        damages = self._account.between("damage", interval.begin - 2 * CYCLE, interval.begin + 4 * CYCLE)
        late: int = LOST_BY_DAMAGE * CYCLE * sum(number for _, (line, number) in damages if line == "motor")
        if any(window.begin <= interval.begin and interval.stopped <= window.end for window in self._gaps.windows):
            late += WATCHDOG
        return late + self._waits.between(interval.begin - STOP_WITHIN, interval.begin)

    def _judge_driven(self, interval: Interval) -> None:
        if self._gaps.in_window(interval.begin) or self._gaps.in_window(interval.end):
            return
        if any(interval.begin + TOLD_WITHIN < utime <= interval.end for utime in self.held):
            # It stood for a reason of its own meanwhile, such as a controller not heard for long on a busy machine.
            self._findings.counts["times the driver held the motors and asked for zero"] += 1
            return
        self._findings.counts["times the robot had to drive again"] += 1
        if not any(any(duty) for _, duty in self._account.between("duty", interval.begin, interval.end)):
            self._findings.blame(interval.end, f"the robot did not drive, though it was to, {interval.why}")
