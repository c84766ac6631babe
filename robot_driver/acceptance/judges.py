"""Judge whether wheels were read, driven and served as promised: from recordings, without clock or I/O."""

import re
import statistics
from collections.abc import Sequence
from itertools import pairwise

from cmr.msg import motor_feedback_t, process_status_t
from robot_driver.acceptance.dialects import Kind
from robot_driver.acceptance.filter import SECOND
from robot_driver.acceptance.findings import Finding, milliseconds
from robot_driver.acceptance.record import Drive, Moments, Record, Span, Wire
from robot_driver.encoders import Wiring

SLACK = 12_000_000  # ns of tolerance between stamps and the relay's times on a busy computer
DUTY_STEP = 0.0006  # half of the coarsest step of a controller, and a little
LEAST_SHARE = 0.95  # share of the readings received by the driver that it must publish
LEAST_PUBLISHED = 5  # messages, for a valid test
LONGER = 0.5  # periods; tolerance of turn times (95 %) with lost replies
LEAST_RATE = 0.88  # of the rate without losses
HELD_UP = 0.12  # s; tolerated delay of this computer
STATED = re.compile(r"Motors served at ([\d.]+) Hz .*? answers in ([\d.]+) ms \(99 % within ([\d.]+) ms\)")


def quantile(values: Sequence[float], share: float) -> float:
    """Return the smallest value that is not exceeded by this share; infinity without values."""
    return sorted(values)[min(int(share * len(values)), len(values) - 1)] if values else float("inf")


Constant = tuple[int, int] | None  # offset of the ticks of left and right from the truth, if known


class Ticks:
    """Compares published ticks with the truth: they differ by a constant from the first message on."""

    def __init__(self, record: Record, wire: Wire) -> None:
        self._record, self._moments = record, Moments(wire.readings)

    def constants(self, message: motor_feedback_t) -> set[tuple[int, int]]:
        """Return the possible constants of a message, from the truth at its stamp."""
        about = self._moments.about(self._record.moment(message.utime), SLACK, round(HELD_UP * SECOND))
        left, right = message.ticks_left, message.ticks_right
        return {(left - one.ticks[0], right - one.ticks[1]) for one in about}

    def constant(self, messages: Sequence[motor_feedback_t]) -> Constant:
        """Return the constant by which most messages differ from the truth."""
        found = [constant for message in messages for constant in self.constants(message)]
        return statistics.mode(found) if found else None

    def false(self, messages: Sequence[motor_feedback_t], constant: Constant) -> int:
        """Return the number of messages that were wrong at their stamp."""
        return sum(constant not in self.constants(message) for message in messages)


def steady_constant(record: Record, wire: Wire, span: Span) -> Constant:
    """Return the offset of ticks from the truth in a span."""
    return Ticks(record, wire).constant(record.feedback_in(span))


def truth(promise: int, check: str, record: Record, wire: Wire, span: Span, constant: Constant) -> Finding:
    """Judge that all ticks published in a span were true at their stamps."""
    messages = record.feedback_in(span)
    false = Ticks(record, wire).false(messages, constant)
    passed = false == 0 and len(messages) >= LEAST_PUBLISHED
    said = f"{len(messages)} readings published, {false} of them not what the device said at that moment"
    return Finding(promise, check, passed, said, {"published": len(messages), "false": false})


def none_lost(promise: int, check: str, record: Record, wire: Wire, span: Span) -> Finding:
    """Judge that all replies that were not deliberately lost were published."""
    inner = Span(span.begin, span.end - SECOND // 5)
    answered = [one for one in wire.of_kind(Kind.COUNTS, inner) if one.delivered]
    published = len(record.feedback_in(inner))
    share = published / len(answered) if answered else 0.0
    said = f"{published} of {len(answered)} readings were published"
    return Finding(
        promise, check, bool(answered) and published >= LEAST_SHARE * len(answered) - 1, said, {"share": share}
    )


def duties_true(record: Record, wire: Wire, span: Span, wiring: Wiring) -> Finding:
    """Judge that each duty reported as in force was acknowledged by the device at the reported time."""
    done = [drive for drive in wire.drives if drive.acknowledged]
    messages, false = record.feedback_in(span), 0
    for message in messages:
        sent = record.moment(message.applied_utime)
        wanted = wiring.channels(message.applied_left, message.applied_right)
        false += not any(abs(drive.asked - sent) < 2 * SLACK and _alike(drive.duty, wanted) for drive in done)
    said = f"{len(messages)} duties reported as in force, {false} of them not acknowledged by the device then"
    return Finding(3, "duties", false == 0 and bool(messages), said, {"reported": len(messages), "false": false})


def _alike(first: tuple[float, float], second: tuple[float, float]) -> bool:
    return all(abs(one - other) < DUTY_STEP for one, other in zip(first, second, strict=True))


def turn_times(wire: Wire, span: Span) -> list[int]:
    """Return the start times of the driver's turns: requests of duties, without repetitions after a doubtful reply."""
    chosen = [one for one in wire.exchanges if span.holds(one.asked)]
    kinds = [wire.dialect.kind(one.request) for one in chosen]
    times = []
    for number, (kind, one) in enumerate(zip(kinds, chosen, strict=True)):
        again = number > 1 and kinds[number - 1] is not Kind.COUNTS and kinds[number - 2] is Kind.DRIVE
        if kind is Kind.DRIVE and not (again and chosen[number - 1].delivered):
            times.append(one.asked)
    return times


def rhythm(wire: Wire, good: Span, bad: Span, rate: float) -> Finding:
    """Judge the periods of the driver's turns with lost replies, against those before."""
    before, reached_before = _turns(wire, good, rate)
    worst, reached = _turns(wire, bad, rate)
    said = f"{reached:.1f} Hz reached, 95 % of turns within {worst:.2f} periods"
    said += f" (without losses {reached_before:.1f} Hz, {before:.2f} periods)"
    passed = worst <= max(before, 1.0) + LONGER and reached >= LEAST_RATE * reached_before
    return Finding(2, "rhythm", passed, said, {"rate_hz": reached, "p95_periods": worst})


def _turns(wire: Wire, span: Span, rate: float) -> tuple[float, float]:
    """Return the number of periods within which 95 % of turns began, and the rate (Hz)."""
    times = turn_times(wire, span)
    periods = [(after - before) / SECOND * rate for before, after in pairwise(times)]
    return quantile(periods, 0.95), len(times) / span.seconds


def cost_of_loss(wire: Wire, span: Span, baud: int) -> Finding:
    """Judge how long the driver waits for a missing reply before it continues."""
    chosen = [one for one in wire.exchanges if span.holds(one.asked)]
    waits = [(after.asked - one.asked) / SECOND for one, after in pairwise(chosen) if one.reply and not one.delivered]
    limit = 0.020 + 10.0 * 60 / baud + 0.010 + 0.012  # margin, the longest reply, the silence, and this computer
    worst = statistics.median(waits) if waits else float("inf")
    said = f"a lost reply is waited for {milliseconds(worst)} (median of {len(waits)}), at most {milliseconds(limit)}"
    return Finding(4, "wait", worst <= limit, said, {"median_s": worst, "losses": len(waits)})


def armed_before_driven(wire: Wire, span: Span) -> Finding:
    """Judge that the watchdog was set and read back before any duty other than zero."""
    dialect = wire.dialect
    first = next((drive.asked for drive in wire.drives_in(span) if drive.moves), span.end)
    before = Span(span.begin, first)
    done = [one for one in wire.of_kind(Kind.SET_WATCHDOG, before) if dialect.acknowledged(one.request, one.reply)]
    if not done:
        return Finding(7, "armed", False, "the watchdog was not set before the motors were driven")
    wanted = dialect.watchdog_set(done[-1].request)
    read = [dialect.watchdog(one.reply) for one in wire.of_kind(Kind.WATCHDOG, Span(done[-1].asked, first))]
    passed = wanted <= 0.5 and wanted in read
    said = (
        f"set to {wanted:g} s, and read back as {', '.join(f'{one} s' for one in read) or 'nothing'}, before any duty"
    )
    return Finding(7, "armed", passed, said, {"watchdog_s": wanted})


def read_while_driving(wire: Wire, span: Span) -> Finding:
    """Judge that the watchdog is read again and again while the motors turn."""
    asked = [span.begin, *(one.asked for one in wire.of_kind(Kind.WATCHDOG, span)), span.end]
    longest = max((after - before) / SECOND for before, after in pairwise(asked))
    said = f"read {len(asked) - 2} times in {span.seconds:.1f} s, {longest:.2f} s apart at most"
    return Finding(7, "read while driving", longest <= 1.0, said, {"longest_s": longest})


def armed_again(wire: Wire, lost_at: int, until: int) -> Finding:
    """Judge the reaction when the device reports that it has lost its watchdog: zero, and arming again."""
    dialect, span = wire.dialect, Span(lost_at, until)
    shown = next((one.answered for one in wire.of_kind(Kind.WATCHDOG, span) if dialect.watchdog(one.delivered) == 0), 0)
    if not shown:
        return Finding(7, "armed again", False, "the driver did not read the watchdog again in time")
    again = next((one.asked for one in wire.of_kind(Kind.SET_WATCHDOG, Span(shown, until))), None)
    moved = [drive for drive in wire.drives_in(Span(shown, again or until)) if drive.moves]
    if again is None or moved:
        said = "the driver drove on" if moved else "the driver did not set it again"
        return Finding(7, "armed again", False, f"the device had no watchdog any more, and {said}")
    seconds = (again - lost_at) / SECOND
    said = f"a device without a watchdog was sent only zero, and armed again after {milliseconds(seconds)}"
    return Finding(7, "armed again", True, said, {"armed_again_s": seconds})


def ramp(promise: int, check: str, drives: Sequence[Drive], acceleration: float, rate: float) -> Finding:
    """Judge that duty grows from zero at most as fast as the ramp allows."""
    allowed = 2.0 * acceleration / rate + 2.0 * DUTY_STEP
    duties = [0.0, *(drive.duty[0] for drive in drives)]
    steps = [abs(after) - abs(before) for before, after in pairwise(duties)]
    largest = max(steps, default=0.0)
    moved = any(drive.moves for drive in drives)
    said = f"duty grew by {100 * largest:.1f} % at a time, at most; {100 * allowed:.1f} % is allowed"
    if not moved:
        said = "the motors were not driven again"
    return Finding(promise, check, moved and largest <= allowed, said, {"largest_step": largest})


def stated(record: Record, wire: Wire, span: Span, extra: float) -> Finding:
    """Judge that the rate and the round-trip time that the driver states are those on the wire.

    `extra` (s) was added to each reply recently; the rate stated by the driver covers a longer time.
    """
    found = [match for one in record.statuses_in(span) if (match := STATED.search(one.message))]
    if not found:
        return Finding(17, "stated", False, "PROCESS_STATUS states no rate or no round-trip time")
    rate, _median, slow = (float(text) for text in found[-1].groups())
    measured = len(turn_times(wire, span)) / span.seconds
    trips = [(one.answered - one.asked) / SECOND for one in wire.exchanges if span.holds(one.asked) and one.delivered]
    true = 1e3 * (quantile(trips, 0.5) + extra)
    passed = (bool(extra) or abs(rate / measured - 1.0) < 0.15) and true - 1.0 <= slow <= true + 30.0
    said = f"states {rate:.1f} Hz and answers within {slow:.1f} ms (99 %); measured {measured:.1f} Hz and {true:.1f} ms"
    return Finding(17, f"stated with {1e3 * extra:.0f} ms more", passed, said, {"rate_hz": rate, "p99_ms": slow})


def round_trips(record: Record, wire: Wire, span: Span) -> dict[str, float]:
    """Return figures on the device: response times (ms), and missing replies."""
    chosen = [one for one in wire.exchanges if span.holds(one.asked)]
    trips = [1e3 * (one.answered - one.asked) / SECOND for one in chosen if one.reply]
    lags = [(one.received_utime - one.utime) / 1e3 for one in record.feedback_in(span)]
    return {
        "requests": len(chosen),
        "unanswered": sum(not one.reply for one in chosen[:-1]),
        "answer_median_ms": quantile(trips, 0.5),
        "answer_p99_ms": quantile(trips, 0.99),
        "reading_to_arrival_median_ms": quantile(lags, 0.5),
    }


def said_degraded(record: Record, since: int, until: int, words: str) -> process_status_t | None:
    """Return the first report of a problem in a time, with these words."""
    return next(
        (
            one
            for one in record.statuses_in(Span(since, until))
            if one.state == process_status_t.DEGRADED and words in one.message
        ),
        None,
    )
