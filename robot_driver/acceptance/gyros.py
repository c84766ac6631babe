"""Judge whether yaw rates were reported as promised: from recordings, without clock or I/O."""

import math
from bisect import bisect_left
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

from robot_driver.acceptance.filter import SECOND, GyroFilter
from robot_driver.acceptance.findings import Finding
from robot_driver.acceptance.record import Record, Span
from robot_driver.gyros import Gyro

ALIKE = 1e-6  # rad/s
ABOUT = SECOND // 4  # ns between a reading and its publication
LARGEST_ERROR = 0.008  # s, rms, of stamps of readings that came in bursts
LEAST_VALID = 20  # readings, for a valid test


class Said(NamedTuple):
    """A reading of the gyro: time of its last byte (ns), and its rate (rad/s); NaN if it was marked invalid."""

    moment: int
    rate: float


def said_by(gyro: Gyro, line: GyroFilter) -> list[Said]:
    """Return the gyro's true readings."""
    return [Said(moment, one.yaw_rate) for moment, data in list(line.heard) for one in gyro.feed(data)]


def increasing(name: str, stamps: Sequence[int], seconds: float) -> Finding:
    """Judge that the stamps of a stream (us) strictly increase."""
    steps = [after - before for before, after in pairwise(stamps)]
    wrong = sum(step <= 0 for step in steps)
    said = f"{len(stamps)} stamps of {name} in {seconds:.0f} s, {wrong} of them not after the one before"
    passed = wrong == 0 and len(stamps) > 1
    return Finding(14, f"{name} increases", passed, said, {"stamps": len(stamps), "wrong": wrong})


def spread(record: Record, truth: Sequence[Said], span: Span, sign: float, rate: float) -> Finding:
    """Judge the stamps of readings that arrived in bursts, against the times at which the gyro sent them.

    Readings are matched by rate and approximate time. The common part of all differences is the time on the wire and in
    the gyro; of this, a stamp may be early by one period.
    """
    moments = [one.moment for one in truth]
    errors = []
    for message in record.gyro_in(span):
        if not message.valid:
            continue
        stamp = record.moment(message.utime)
        begin = bisect_left(moments, stamp - ABOUT)
        end = bisect_left(moments, stamp + ABOUT)
        near = [one.moment for one in truth[begin:end] if abs(sign * one.rate - message.yaw_rate) < ALIKE]
        if near:
            errors.append(min((stamp - moment for moment in near), key=abs) / SECOND)
    if len(errors) < LEAST_VALID:
        return Finding(14, "bursts", False, f"only {len(errors)} readings could be compared")
    half = 0.5 / rate if rate else 0.0  # of a period, for the reading and its time on the wire
    rms = math.sqrt(sum((error + half) ** 2 for error in errors) / len(errors))
    said = f"{len(errors)} readings in bursts, their stamps {1e3 * rms:.1f} ms (rms) from when they were sent"
    return Finding(14, "bursts", rms <= LARGEST_ERROR, said, {"rms_s": rms, "compared": len(errors)})


def only_rates(check: str, record: Record, truth: Sequence[Said], span: Span, sign: float) -> Finding:
    """Judge that each valid yaw rate was a reading of the gyro around that time."""
    moments = [one.moment for one in truth]
    valid = [message for message in record.gyro_in(span) if message.valid]
    false = 0
    for message in valid:
        stamp = record.moment(message.utime)
        near = truth[bisect_left(moments, stamp - ABOUT) : bisect_left(moments, stamp + ABOUT)]
        false += not any(abs(sign * one.rate - message.yaw_rate) < ALIKE for one in near)
    said = f"{len(valid)} yaw rates reported as valid, {false} of them not what the gyro said then"
    passed = false == 0 and len(valid) >= LEAST_VALID
    return Finding(15, check, passed, said, {"valid": len(valid), "false": false})


def none_valid(check: str, record: Record, span: Span, why: str) -> Finding:
    """Judge that no rate was reported for a time without readings."""
    inner = Span(span.begin + SECOND // 10, span.end)
    valid = sum(bool(message.valid) for message in record.gyro_in(inner))
    said = f"while {why}, for {span.seconds:.1f} s, {valid} yaw rates were reported as valid"
    return Finding(15, check, valid == 0, said, {"valid": valid})
