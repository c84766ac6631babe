"""Checks of time stamps and the log itself: gaps, rates, and messages that were late, repeated or lost."""

import numpy as np

from cmr.recordings.faults.findings import Finding, counted
from cmr.recordings.log_clock import LATEST_UTIME
from cmr.recordings.recording import Recording
from cmr.recordings.signal import SECONDS, Floats, Mask, Signal

LARGEST_VALUE = 1e9  # of any quantity: a larger value is damaged
GAP_PERIODS, SHORTEST_GAP = 5.0, 0.1  # a gap is longer than this many periods and this many seconds
UNEVEN = 0.5  # an interval that differs by more than this share from the usual one
UNEVEN_SHARE = 0.1  # of the intervals; where more are uneven, the rate is
LONGEST_DOUBT = 0.003  # s; a reading with a less certain time is not used for motion
REPEATED = "of a time that was there before"


def damaged_samples(recording: Recording) -> Finding:
    """Find samples of an impossible time or value."""
    damaged = {name: _damaged(signal) for name, signal in recording.signals.items()}
    total = sum(int(np.count_nonzero(mask)) for mask in damaged.values())
    sentence = f"{counted(total, 'sample')} of an impossible time or value: set aside."
    return Finding("damaged_samples", total, sentence, {name: mask for name, mask in damaged.items() if mask.any()})


def log_findings(recording: Recording) -> list[Finding]:
    """Report unreadable parts of the log, and messages that are not samples."""
    rejected = sum(recording.rejected.values())
    reasons = ", ".join(f"{count} x {channel} {reason}" for (channel, reason), count in recording.rejected.items())
    signals = recording.signals
    unusable = {
        name: {why: count for why, count in signal.left_out.items() if why != REPEATED}
        for name, signal in signals.items()
    }
    described = ", ".join(f"{n} x {name} {why}" for name, left in unusable.items() for why, n in left.items())
    repeated = {name: signal.left_out.get(REPEATED, 0) for name, signal in signals.items()}
    late = {name: _lateness(signal) for name, signal in signals.items()}
    came_late = sum(int(np.count_nonzero(lateness)) for lateness in late.values())
    latest = max((float(lateness.max(initial=0.0)) for lateness in late.values()), default=0.0)
    return [
        Finding(
            "damaged_log",
            recording.damaged_bytes,
            f"{recording.damaged_bytes} bytes of the log are truncated or damaged: the rest is used.",
        ),
        Finding("rejected_messages", rejected, f"{counted(rejected, 'message')} could not be taken: {reasons}."),
        Finding(
            "unusable_messages",
            sum(sum(left.values()) for left in unusable.values()),
            f"Messages without a usable value: {described}.",
        ),
        Finding(
            "repeated_times",
            sum(repeated.values()),
            f"Messages that repeat a time stamp, of which the first is used: {_listed(repeated)}.",
        ),
        Finding(
            "late_messages",
            came_late,
            f"{counted(came_late, 'message')} came after a later one of the same sensor, by up to {latest:.2f} s: put "
            "in order of time.",
        ),
    ]


def held_up(wheels: Signal) -> Mask:
    """Return which readings have an unknown time, because they arrived long after their stamps.

    The driver stamps a reading midway between question and answer; it may have been taken at any time between them.
    Other software, which does not report when duties were sent, may stamp differently: a board its own samples, for
    instance.
    """
    if not np.any(wheels.fields.get("applied_utime", np.zeros(1)) > 0):
        return np.zeros(len(wheels), np.bool_)
    late = (wheels.fields.get("received_utime", wheels.utime) - wheels.utime) * SECONDS
    late = np.where(np.isfinite(late), late, 0.0)
    return np.asarray(late > np.median(late) + LONGEST_DOUBT) if len(late) else np.zeros(0, np.bool_)


def held_up_finding(recording: Recording) -> Finding:
    """Count the wheel readings with unknown times; their duties are still used."""
    found = int(np.count_nonzero(held_up(recording.wheels)))
    return Finding(
        "held_up_readings",
        found,
        f"{counted(found, 'reading')} of the wheels came more than {1e3 * LONGEST_DOUBT:.0f} ms later than usual, "
        "so it is not known when they were taken: the computer, or an adapter, delayed them. They are left out.",
    )


def rates_of(recording: Recording) -> dict[str, float]:
    """Return the rate of each recorded signal [Hz], from the median interval."""
    return {
        name: float(1.0 / np.median(_intervals(signal)))
        for name, signal in recording.signals.items()
        if len(signal) > 1
    }


def gap_findings(recording: Recording) -> list[Finding]:
    """Find gaps in the signals, and rates that are uneven.

    A pause of all signals is not a gap: a signal has a gap if others continued.
    """
    gaps: dict[str, int] = {}
    uneven: dict[str, int] = {}
    longest = 0.0
    for name, signal in recording.signals.items():
        if len(signal) < 3:
            continue
        intervals = np.diff(recording.pieces.seconds(signal.utime))
        usual = float(np.median(_intervals(signal)))
        wide = intervals > max(GAP_PERIODS * usual, SHORTEST_GAP)
        gaps[name] = int(np.count_nonzero(wide))
        longest = max(longest, float(intervals[wide].max(initial=0.0)))
        even = intervals[~wide & ~recording.pieces.borders(signal.utime)[1:]]
        uneven[name] = int(len(even) and np.mean(np.abs(even - usual) > UNEVEN * usual) > UNEVEN_SHARE)
    rates = ", ".join(f"{name} {rate:.1f} Hz" for name, rate in rates_of(recording).items())
    return [
        Finding("gaps", sum(gaps.values()), f"Gaps in the data: {_listed(gaps)}; the longest is {longest:.2f} s."),
        Finding(
            "uneven_rates",
            sum(uneven.values()),
            f"Not at even intervals: {', '.join(name for name, found in uneven.items() if found)} (rates: {rates}).",
        ),
    ]


def _damaged(signal: Signal) -> Mask:
    damaged = (signal.utime < 0) | (signal.utime > LATEST_UTIME)
    for name, values in signal.fields.items():
        if not name.endswith("utime"):
            damaged |= np.abs(values) > LARGEST_VALUE
    return damaged


def _lateness(signal: Signal) -> Floats:
    """Return how much older each sample, in the order of arrival, is than the newest before it [s]."""
    utime = signal.utime[np.argsort(signal.number)] if len(signal.number) else signal.utime
    return np.asarray((np.maximum.accumulate(utime) - utime) * SECONDS, np.float64)


def _intervals(signal: Signal) -> Floats:
    return np.asarray(np.diff(signal.utime) * SECONDS, np.float64)


def _listed(counts: dict[str, int]) -> str:
    return ", ".join(f"{name} {count}" for name, count in counts.items() if count)
