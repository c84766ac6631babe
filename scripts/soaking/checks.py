"""Check what a driver publishes, and the duties of its motors, while faults occur.

Times are in us since the Unix epoch. A message is checked as soon as the ground truth of its time, recorded by the
emulated robot, is complete. Each finding is a sentence; a soak test passes if there are none.
"""

import bisect
import math
import sys
from collections import Counter, defaultdict, deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from soaking.robot import FULL_DUTY, Record

US_PER_S = 1_000_000  # us
CYCLE = 20_000  # us; at 50 Hz
LARGEST_GAP = 5 * CYCLE  # between two messages, if only single packets are damaged
LOST_BY_DAMAGE = 2  # cycles: damage costs its own transaction or reading, and at most the next
SLOWING = {("motor", "latency"): 50_000, ("motor", "pieces"): 50_000}  # us per cycle during these faults
RECOVERY = 2_500_000  # us after the end of a fault: pauses of up to 1 s, and two attempts to connect
RECONNECTED = 100_000  # us; after a shorter gap, the driver cannot have reconnected
REPORTED_WITHIN = 500_000  # us from a device's answer to the message that reports it
TELEMETRY_AGE = 5 * US_PER_S  # largest age of slow values, such as the battery voltage
LONG_WAIT = 10_000  # us for a processor, within one sample
CLOCK_TOLERANCE = 5_000  # us by which a message may seem earlier than the answer that it reports
KEPT = 30 * US_PER_S  # of the ground truth
STOP_WITHIN = 500_000 + CYCLE  # us, from a stop or from the last command to zero duty
WATCHDOG = 500_000  # us without a byte after which the controller stops by itself
LARGEST_STEP = 0.4  # of the duty, from rest: 10 per second for two cycles
LARGEST_SPEED = 200.0  # rad/s
TICKS_PER_TURN = 2048
COUNTER_RANGE = 2**32
STALLS_BEFORE, STALLS_AFTER = (
    US_PER_S,
    US_PER_S // 10,
)  # us; stalls of the machine in this time around a finding are shown


class Window(NamedTuple):
    """The time in which a fault, or the recovery from it, explains gaps in one stream."""

    stream: str
    name: str
    begin: int
    end: int


@dataclass
class Interval:
    """An interval in which the motors must stand still (`still`), or must be driven at least once, and the reason.

    `stopped` is the time of the event that demands the stop. `patient`: the driver waits before it stops, so lost
    packets can delay the stop.
    """

    begin: int
    end: int
    still: bool
    why: str
    stopped: int = 0
    patient: bool = False


@dataclass
class Findings:
    """The failed checks, as sentences in `failures`, and statistics."""

    failures: list[str] = field(default_factory=list)
    counts: Counter[str] = field(default_factory=Counter)
    largest: dict[str, float] = field(default_factory=lambda: defaultdict(float))  # s
    stamp_errors: list[int] = field(default_factory=list)  # us
    stalls: deque[tuple[int, int]] = field(default_factory=lambda: deque(maxlen=1000))  # begin, end

    def note_stall(self, begin: int, end: int) -> None:
        """Record that the machine stood still."""
        self.stalls.append((begin, end))
        self.counts["times the machine stood still"] += 1
        key = "the machine stood still"
        self.largest[key] = max(self.largest[key], (end - begin) / US_PER_S)

    def report_failure(self, utime: int, text: str) -> None:
        """Record and print a failed check, with the stalls of the machine near that time."""
        near = [
            end - begin for begin, end in self.stalls if begin < utime + STALLS_AFTER and end > utime - STALLS_BEFORE
        ]
        stood = f"stood still {len(near)} times, at most {max(near) / 1000:.0f} ms" if near else "ran"
        self.failures.append(f"{utime / US_PER_S:.3f}: {text}; in the second before, the machine {stood}")
        print(f"FAILED {self.failures[-1]}", file=sys.stderr, flush=True)


class GroundTruth:
    """The ground truth that the emulated robot records, for the last 30 s; complete until `upto`."""

    def __init__(self) -> None:
        self.upto = 0
        self._times: dict[str, deque[int]] = defaultdict(deque)
        self._values: dict[str, deque[Any]] = defaultdict(deque)

    def add(self, record: Record) -> None:
        """Add the next record."""
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
        """Return the value of the last record of a kind until `utime`; None if there is none."""
        index = bisect.bisect_right(self._times[kind], utime)
        return self._values[kind][index - 1] if index else None


class Gaps:
    """Checks that the timestamps of one stream increase, and that each gap between them is explained."""

    def __init__(
        self, stream: str, line: str, period: int, ground_truth: GroundTruth, waits: "WaitHistory", findings: Findings
    ) -> None:
        self.windows: list[Window] = []
        self.others: list[Window] = []  # faults that do not explain a gap, but are shown with it
        self.last = 0
        self._period = period
        self._stream = stream
        self._line = line
        self._ground_truth = ground_truth
        self._waits = waits
        self._findings = findings

    def check(self, utime: int) -> int:
        """Check the timestamp of the next message; return the time since the last message [us]."""
        gap, begin, self.last = utime - self.last if self.last else 0, self.last, utime
        if begin and gap <= 0:
            self._findings.report_failure(
                utime, f"the timestamp of {self._stream} is not later than the last one: {gap} us"
            )
        if gap > LARGEST_GAP:
            self._explain(begin, utime)
        return gap

    def in_window(self, utime: int) -> bool:
        """Return whether this stream may be interrupted at `utime` by a fault, or by the recovery from it."""
        return any(window.begin <= utime <= window.end for window in self.windows)

    def _explain(self, begin: int, end: int) -> None:
        gap = end - begin
        damages = sum(self._of_line("damage", begin - CYCLE, end))
        near = [window for window in (*self.windows, *self.others) if window.begin <= end and begin <= window.end]
        turn = max([self._period, *(SLOWING.get((self._line, window.name), 0) for window in near)])
        lates = self._of_line("late", begin - CYCLE, end)
        losses = len(lates) + self._waits.long_ones(begin, end)  # answers that came, or were read, too late
        waited = self._waits.between(begin, end) + sum(lates) + losses * LOST_BY_DAMAGE * turn
        if any(window.begin <= begin + LARGEST_GAP and end <= window.end for window in self.windows):
            why = "a fault"
        elif gap <= LARGEST_GAP + damages * LOST_BY_DAMAGE * turn:
            why = "damage"
        elif gap <= LARGEST_GAP + damages * LOST_BY_DAMAGE * turn + waited:
            why = "a busy machine"
        else:
            why = "nothing"
            self._findings.report_failure(
                end,
                f"{self._stream} paused for {gap / US_PER_S:.3f} s: {damages} damaged packets, "
                f"{waited / US_PER_S:.3f} s of waiting, faults: {', '.join(fault.name for fault in near) or 'none'}",
            )
        self._findings.counts[f"{self._stream} gaps above 0.1 s explained by {why}"] += 1
        key = f"{self._stream} longest gap explained by {why}"
        self._findings.largest[key] = max(self._findings.largest[key], gap / US_PER_S)

    def _of_line(self, kind: str, begin: int, end: int) -> list[int]:
        """Return the numbers in the records of a kind for the line of this stream."""
        return [number for _, (line, number) in self._ground_truth.between(kind, begin, end) if line == self._line]


class WaitHistory:
    """How long the driver, the emulator and the kernel's workers have waited for a processor."""

    def __init__(self) -> None:
        self._times: deque[int] = deque(maxlen=20_000)
        self._totals: deque[int] = deque(maxlen=20_000)

    def add(self, utime: int, total: int) -> None:
        """Add a sample: the total waiting time until `utime` [us]."""
        self._times.append(utime)
        self._totals.append(total)

    def before(self, utime: int) -> int:
        """Return how long they waited in the 3 s before a time [us]."""
        return self.between(utime - KEPT // 10, utime)

    def between(self, begin: int, end: int) -> int:
        """Return how long they waited between two times [us], including all of the samples at both ends."""
        return sum(self._each(begin, end))

    def long_ones(self, begin: int, end: int) -> int:
        """Return in how many samples they waited so long that an answer may have come too late."""
        return sum(wait > LONG_WAIT for wait in self._each(begin, end))

    def _each(self, begin: int, end: int) -> list[int]:
        first = max(bisect.bisect_right(self._times, begin) - 1, 0)
        last = min(bisect.bisect_left(self._times, end), len(self._times) - 1)
        return [self._totals[index + 1] - self._totals[index] for index in range(first, last)]


class MotorChecks:
    """Compares MOTOR_FEEDBACK with the answers of the motor controller."""

    def __init__(self, ground_truth: GroundTruth, gaps: Gaps, waits: WaitHistory, findings: Findings) -> None:
        self._ground_truth = ground_truth
        self._gaps = gaps
        self._waits = waits
        self._findings = findings
        self._offsets: set[tuple[int, int]] = set()
        self._before: Any = None

    def check(self, message: Any) -> None:
        """Check the next message."""
        begin = self._gaps.last
        gap = self._gaps.check(message.utime)
        self._findings.counts["MOTOR_FEEDBACK"] += 1
        rebased = self._check_counts(message, gap, begin)
        if self._before is not None and not rebased:
            self._check_speed(message, self._before)
        self._before = message
        self._check_others(message)

    def _check_counts(self, message: Any, gap: int, begin: int) -> bool:
        """Check that published totals and answered counts still differ by the same offset.

        After a fault the offset may change; return whether this is such a case.
        """
        received = message.received_utime
        recent = received - REPORTED_WITHIN - self._waits.before(received), received + CLOCK_TOLERANCE
        offsets = {
            ((first - message.ticks_left) % COUNTER_RANGE, (second - message.ticks_right) % COUNTER_RANGE)
            for _, (first, second) in self._ground_truth.between("counts", *recent)
        }
        known, self._offsets = self._offsets, offsets
        if not begin or (gap > RECONNECTED and self._gaps.in_window(message.utime)):
            return True
        self._offsets = known & offsets or offsets
        if not known & offsets:
            self._findings.report_failure(
                message.utime,
                f"ticks {message.ticks_left}, {message.ticks_right} are not what was answered: they differ by "
                f"{_differences(known, offsets)} after {gap / US_PER_S:.3f} s",
            )
        return False

    def _check_speed(self, message: Any, before: Any) -> None:
        seconds = (message.utime - before.utime) / US_PER_S
        for side in ("left", "right"):
            ticks = getattr(message, f"ticks_{side}") - getattr(before, f"ticks_{side}")
            true, stated = ticks * 2 * math.pi / TICKS_PER_TURN / seconds, getattr(message, f"psi_{side}")
            if not (abs(stated) <= LARGEST_SPEED and abs(stated - true) <= 0.05 + 0.02 * abs(true)):
                self._findings.report_failure(
                    message.utime, f"psi_{side} {stated:.3f} rad/s, but {true:.3f} by the ticks"
                )

    def _check_others(self, message: Any) -> None:
        received = message.received_utime
        stated = {
            "duty": (round(message.applied_left * FULL_DUTY), round(message.applied_right * FULL_DUTY)),
            "battery": (message.battery_voltage,),
            "currents": (message.current_left, message.current_right),
            "temperature": (message.temperature,),
        }
        for kind, values in stated.items():
            true = self._ground_truth.between(kind, received - TELEMETRY_AGE, received + CLOCK_TOLERANCE)
            if not math.isnan(values[0]) and not any(all(map(math.isclose, values, sent)) for _, sent in true):
                self._findings.report_failure(message.utime, f"{kind} {values} is not what was answered")


def _differences(known: set[tuple[int, int]], now: set[tuple[int, int]]) -> str:
    """Return the differences (left, right) between reports and the newest answers, in ticks."""
    (left, right), *_ = known or {(0, 0)}
    return ", ".join(f"({left - first}, {right - second})" for first, second in list(now)[-3:]) or "unknown"


class GyroChecks:
    """Compares GYRO with the readings that the gyro sent.

    Without a checksum in the protocol, a damaged line may be read as a valid one; such readings are counted.
    """

    def __init__(self, ground_truth: GroundTruth, gaps: Gaps, waits: WaitHistory, findings: Findings) -> None:
        self._ground_truth = ground_truth
        self._gaps = gaps
        self._waits = waits
        self._findings = findings

    def check(self, message: Any) -> None:
        """Check the next message."""
        self._gaps.check(message.utime)
        self._findings.counts["GYRO"] += 1
        if not message.valid:
            self._findings.counts["GYRO reported as not valid"] += 1
            if not math.isnan(message.yaw_rate):
                self._findings.report_failure(message.utime, "an invalid gyro reading has a yaw rate")
            return
        received = message.received_utime
        recent = received - REPORTED_WITHIN - self._waits.before(received), received + CLOCK_TOLERANCE
        true = [utime for utime, sent in self._ground_truth.between("rate", *recent) if _equals(message, sent)]
        if true:
            self._findings.stamp_errors.append(min((message.utime - utime for utime in true), key=abs))
        elif any(_equals(message, sent) for _, sent in self._ground_truth.between("misread", *recent)):
            self._findings.counts["GYRO readings with undetectable damage"] += 1
        else:
            self._findings.report_failure(message.utime, f"yaw rate {message.yaw_rate:.6f} rad/s is not what was sent")


def _equals(message: Any, sent: tuple[float, bool]) -> bool:
    return sent[1] and math.isclose(message.yaw_rate, sent[0], rel_tol=1e-6, abs_tol=1e-12)


class DriveChecks:
    """Checks the duties of the motors."""

    def __init__(
        self, ground_truth: GroundTruth, gaps: Gaps, waits: WaitHistory, findings: Findings, largest_duty: float
    ) -> None:
        self.intervals: list[Interval] = []
        self.held: list[int] = []  # times at which the driver reported that it waits for a zero command
        self._ground_truth = ground_truth
        self._gaps = gaps
        self._waits = waits
        self._findings = findings
        self._limit = round(largest_duty * FULL_DUTY) + 1
        self._duty = (0, 0)

    def check(self, record: Record) -> None:
        """Check the next duty."""
        before, self._duty = self._duty, record.value
        if max(map(abs, record.value)) > self._limit:
            self._findings.report_failure(record.utime, f"duty {record.value} was never commanded")
        for old, new in zip(before, record.value, strict=True):
            if old == 0 and abs(new) > LARGEST_STEP * FULL_DUTY + 1:
                self._findings.report_failure(record.utime, f"duty jumps from {before} to {record.value}")

    def judge(self) -> None:
        """Check the intervals for which the ground truth is complete."""
        over = [interval for interval in self.intervals if interval.end < self._ground_truth.upto]
        self.intervals = [interval for interval in self.intervals if interval.end >= self._ground_truth.upto]
        for interval in over:
            (self._judge_still if interval.still else self._judge_driven)(interval)

    def _judge_still(self, interval: Interval) -> None:
        self._findings.counts[f"stops by {interval.why}"] += 1
        duties = list(self._ground_truth.between("duty", interval.stopped, interval.end))
        moving = [utime for utime, duty in duties if any(duty)]
        if moving:
            stood = next((utime for utime, duty in duties if utime > moving[-1] and not any(duty)), interval.end)
            seconds = (stood - interval.stopped) / US_PER_S
            key = f"longest time from {interval.why} to zero duty"
            self._findings.largest[key] = max(self._findings.largest[key], seconds)
        begin = interval.begin + self._lateness(interval)
        if begin >= interval.end:
            return
        before = self._ground_truth.last_before("duty", begin)
        if any(before or ()) or any(utime >= begin for utime in moving):
            self._findings.report_failure(interval.begin, f"the motors were driven after {interval.why}")

    def _lateness(self, interval: Interval) -> int:
        """Return how much later the duty may become zero because of lost packets, a fault or a busy machine [us]."""
        if not interval.patient:
            return 0
        damages = self._ground_truth.between("damage", interval.begin - 2 * CYCLE, interval.begin + 4 * CYCLE)
        late: int = LOST_BY_DAMAGE * CYCLE * sum(number for _, (line, number) in damages if line == "motor")
        if any(window.begin <= interval.begin and interval.stopped <= window.end for window in self._gaps.windows):
            late += WATCHDOG
        return late + self._waits.between(interval.begin - STOP_WITHIN, interval.begin)

    def _judge_driven(self, interval: Interval) -> None:
        if self._gaps.in_window(interval.begin) or self._gaps.in_window(interval.end):
            return
        if any(interval.begin + REPORTED_WITHIN < utime <= interval.end for utime in self.held):
            # The driver stopped for another reason, such as a controller that did not answer on a busy machine.
            self._findings.counts["times the driver stopped the motors and asked for a zero command"] += 1
            return
        self._findings.counts["times the robot had to drive again"] += 1
        if not any(any(duty) for _, duty in self._ground_truth.between("duty", interval.begin, interval.end)):
            self._findings.report_failure(interval.end, f"the robot should have driven but did not, {interval.why}")
