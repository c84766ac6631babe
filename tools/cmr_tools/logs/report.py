"""Report of cmr-log info: a line about the whole, a table of the channels, and problems in words.

For programs, the same as one document.
"""

import math
from datetime import datetime, timedelta, timezone

from cmr.recordings.events import EventReader
from cmr_tools.events import damage_sentence
from cmr_tools.logs.info import ChannelHealth, LogHealth

EPOCH = datetime(1970, 1, 1, tzinfo=timezone.utc)
HEADINGS = (
    "channel", "type", "messages", "rate [Hz]", "size [kB]", "gaps", "longest [s]", "jitter [ms]", "errors", "late",
)  # fmt: skip
LEGEND = (
    "gaps: intervals longer than three usual ones; longest: the longest interval; jitter: standard deviation of "
    "the intervals that are no gaps;",
    "errors: messages that do not decode; late: older than the message ahead of them; -: nothing to expect",
)


def document(log: EventReader, health: LogHealth) -> dict[str, object]:
    """Return the data on a log that has been read, in the format of docs/reference/json.md."""
    return {
        "path": log.path,
        "bytes": log.size,
        "damaged_bytes": log.damaged_bytes,
        "damaged_places": log.damaged_places,
        "events": health.count,
        "first_utime": health.first,
        "seconds": health.seconds(health.latest),
        "channels": {name: _of_channel(channel, health) for name, channel in sorted(health.channels.items())},
    }


def _of_channel(channel: ChannelHealth, health: LogHealth) -> dict[str, object]:
    rhythm = channel.rhythm()
    return {
        "type": channel.type_name,
        "messages": channel.count,
        "rate": channel.rate,
        "bytes": channel.bytes,
        "gaps": None if rhythm is None else rhythm.gaps,
        "longest": None if rhythm is None else rhythm.longest,
        "longest_at": None if rhythm is None else health.seconds(rhythm.longest_at),
        "jitter": None if rhythm is None else rhythm.jitter,
        "errors": dict(channel.rejected) if channel.channel is not None else None,
        "late": channel.late,
    }


def report(log: EventReader, health: LogHealth) -> list[str]:
    """Return the lines about a log that has been read."""
    if health.count == 0:
        return [f"{log.path}: no intact event in {log.size} bytes. Is it an event log, as lcm-logger writes it?"]
    seconds = health.seconds(health.latest)
    channels = "1 channel" if len(health.channels) == 1 else f"{len(health.channels)} channels"
    head = f"{log.path}: {health.count} events on {channels}, {log.size / 1e6:.3g} MB, {seconds:.3f} s from "
    damage = damage_sentence(log) or f"{log.path}: no damage."
    rows = [_row(name, channel) for name, channel in sorted(health.channels.items())]
    return [head + f"{_moment(health.first)} on", damage, "", *_aligned([HEADINGS, *rows]), *LEGEND, *_faults(health)]


def _row(name: str, health: ChannelHealth) -> tuple[str, ...]:
    rhythm = health.rhythm()
    jitter = math.nan if rhythm is None else rhythm.jitter * 1e3
    return (
        name,
        health.type_name,
        str(health.count),
        _number(health.rate),
        f"{health.bytes / 1e3:.1f}",
        "-" if rhythm is None else str(rhythm.gaps),
        "-" if rhythm is None else f"{rhythm.longest:.3f}",
        _number(jitter),
        str(health.rejected.total()) if health.channel is not None else "-",
        str(health.late),
    )


def _number(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.2f}"


def _aligned(rows: list[tuple[str, ...]]) -> list[str]:
    """Return the rows as lines: the first two columns to the left, the numbers to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = []
    for row in rows:
        cells = [
            cell.ljust(width) if place < 2 else cell.rjust(width)
            for place, (cell, width) in enumerate(zip(row, widths, strict=True))
        ]
        lines.append("  ".join(cells))
    return lines


def _faults(health: LogHealth) -> list[str]:
    """Return a sentence for each channel with gaps or messages that do not decode."""
    lines = []
    for name, channel in sorted(health.channels.items()):
        rhythm = channel.rhythm()
        if rhythm is not None and rhythm.gaps:
            at = health.seconds(rhythm.longest_at)
            gaps = "1 gap" if rhythm.gaps == 1 else f"{rhythm.gaps} gaps"
            lines.append(f"{name}: {gaps}, the longest of {rhythm.longest:.3f} s, {at:.3f} s after the log's start.")
        lines += [f"{name}: {count} x {reason}." for reason, count in sorted(channel.rejected.items())]
    return lines


def _moment(utime: int) -> str:
    """Return a time of day in words; the number itself if it is outside the calendar."""
    try:
        return f"{EPOCH + timedelta(microseconds=utime):%Y-%m-%d %H:%M:%S} UTC"
    except OverflowError:
        return f"utime {utime}"
