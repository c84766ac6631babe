"""Judge whether motors stopped and nothing else moved: from recordings, without clock or I/O."""

import math

from robot_driver.acceptance.filter import SECOND
from robot_driver.acceptance.findings import Finding, milliseconds
from robot_driver.acceptance.judges import HELD_UP, said_degraded
from robot_driver.acceptance.record import Record, Span, Wire

WATCHDOG = 0.5  # s, of the device
STANDING = 1.5  # s until lifted wheels stand without drive
COASTING = 0.35  # s of coasting from full speed, at most
REPORTED = 0.5  # s after which the loss of a port is reported
LONGEST_PAUSE = 1.0  # s between attempts to get a device back
CONNECTING = 1.0  # s for connecting, at most
LEAST_SPEED = 20.0  # ticks/s; with less, nothing was driven, and no time can be derived


def zero_within(promise: int, check: str, wire: Wire, span: Span, limit: float) -> Finding:
    """Judge that zero was sent and acknowledged in time after the beginning of a span, and that the wheels stopped."""
    moving = [drive for drive in wire.drives if drive.moves and drive.asked < span.begin]
    zero = wire.first_zero(span.begin)
    after = [drive for drive in wire.drives_in(span) if drive.moves and zero is not None and drive.asked > zero.asked]
    if not moving or span.begin - moving[-1].asked > SECOND:
        return Finding(promise, check, False, "the motors were not driven before")
    if zero is None or zero.asked > span.end:
        return Finding(promise, check, False, f"no zero came within {span.seconds:.1f} s")
    if after:
        return Finding(promise, check, False, "after zero the motors were driven again")
    seconds = (zero.asked - span.begin) / SECOND
    stood = wire.stood_after(span.begin, span.end)
    done = any(drive.acknowledged and not drive.moves for drive in wire.drives_in(span))
    passed = seconds <= limit + HELD_UP and done and not stood > seconds + STANDING
    said = f"zero {'acknowledged' if done else 'not acknowledged'} after {milliseconds(seconds)}"
    said += f", the wheels stood after {milliseconds(stood)} (by the encoders)" if math.isfinite(stood) else ""
    return Finding(promise, check, passed, said, {"zero_s": seconds, "stood_s": stood, "limit_s": limit})


def bounded(promise: int, check: str, wire: Wire, since: int, limit: float, until: int) -> Finding:
    """Judge an upper bound of the time to stop: the counts gained by the first reading after `until`, over the speed.

    For lines that must be silent, because some controllers take each byte as a sign of life.
    """
    speed, gained = wire.speed(since), wire.gained(since, until)
    if gained is None or speed < LEAST_SPEED:
        return Finding(promise, check, False, "the wheels did not turn before, or were not read afterwards")
    seconds = gained / speed
    passed = seconds <= limit + COASTING + HELD_UP
    said = f"{gained} counts gained at {speed:.0f} counts/s: the motors stopped within {seconds:.2f} s, at most"
    return Finding(promise, check, passed, said, {"bound_s": seconds, "limit_s": limit})


def nothing_moves(promise: int, check: str, wire: Wire, span: Span, why: str) -> Finding:
    """Judge that nothing but zero was sent in a span, while something else was commanded."""
    moved = [drive for drive in wire.drives_in(span) if drive.moves]
    said = f"{why}: {len(moved)} of {len(wire.drives_in(span))} duties sent in {span.seconds:.1f} s were not zero"
    served = bool(wire.drives_in(span))
    return Finding(promise, check, served and not moved, said, {"moved": len(moved)})


def moves(promise: int, check: str, wire: Wire, span: Span, why: str) -> Finding:
    """Judge that the motors were driven in a span."""
    moved = any(drive.moves for drive in wire.drives_in(span))
    return Finding(promise, check, moved, f"{why}: {'driven' if moved else 'not driven'}")


def ended_at_zero(check: str, wire: Wire, asked_at: int, ended_at: int, code: int | None) -> Finding:
    """Judge the end by a signal, at which the reply to the first zero was lost."""
    drives = wire.drives_in(Span(asked_at - SECOND // 10, ended_at))
    seconds = (ended_at - asked_at) / SECOND
    acknowledged = bool(drives) and not drives[-1].moves and drives[-1].seen
    passed = acknowledged and code == 130 and seconds < 1.0 + 2 * HELD_UP
    said = f"ended {milliseconds(seconds)} after it, with code {code}; the last duty was "
    said += "zero, acknowledged" if acknowledged else "not zero, or not acknowledged"
    return Finding(9, check, passed, said, {"ended_s": seconds})


def unplugged(record: Record, wire: Wire, out: int, back: int, until: int) -> list[Finding]:
    """Judge a port that disappeared at `out` and was back at `back`."""
    told = said_degraded(record, out, back, "")
    reported = (record.moment(told.utime) - out) / SECOND if told else float("inf")
    first = next((one.asked for one in wire.exchanges if one.asked > back), None)
    again = (first - back) / SECOND if first else float("inf")
    said = f"reported after {milliseconds(reported)}"
    result = [Finding(10, "reported", reported <= REPORTED + HELD_UP, said, {"reported_s": reported})]
    said = f"asked again {milliseconds(again)} after it was back"
    passed = again <= LONGEST_PAUSE + HELD_UP + 0.2
    result.append(Finding(10, "asked again", passed, said, {"again_s": again}))
    drives = wire.drives_in(Span(back, until))
    passed = bool(drives) and not drives[0].moves and any(drive.moves for drive in drives)
    said = "the first duty was zero" if drives and not drives[0].moves else "the first duty was not zero"
    said += ", and it drove again" if any(drive.moves for drive in drives) else ", and it did not drive again"
    return [*result, Finding(10, "from zero", passed, said)]
