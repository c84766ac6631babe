"""Tables read from a foreign recording: columns over time as NumPy arrays; and the reader of LCM logs."""

from array import array
from collections import Counter
from collections.abc import Mapping as Dictionary
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmr.files import open_regular
from cmr.recordings.events import Event, EventReader
from cmr.recordings.log_clock import LATEST_UTIME
from cmr_tools.events import progress_of, reading
from cmr_tools.importing.layout import Column, decode, message_bytes
from cmr_tools.importing.mapping_types import Mapping


class SourceError(Exception):
    """The recording cannot be read with this mapping; the text says why."""


@dataclass(frozen=True)
class Table:
    """Rows in the order of time.

    `utime` and `received_utime` [us], shape (n,), int64, not decreasing; `segment` numbers the pieces of a recording
    that is not continuous; `columns` are of shape (n,), NaN where a CSV cell holds no number.
    """

    utime: NDArray[np.int64]
    received_utime: NDArray[np.int64]
    segment: NDArray[np.int64]
    columns: dict[str, Column]


@dataclass(frozen=True)
class Piece:
    """Start of a piece of a recording that is not continuous: at `utime` [us] of the log.

    There its label in the recording is `name`, and its own time `seconds` [s].
    """

    utime: int
    name: str
    seconds: float


@dataclass
class Source:
    """The result of reading: tables by name, numbers of skipped rows by (place, reason), and sentences about damage.

    `pieces` are those that the import separated, in order of time; empty for a continuous recording.
    """

    tables: dict[str, Table]
    skipped: Counter[tuple[str, str]] = field(default_factory=Counter)
    notes: list[str] = field(default_factory=list)
    pieces: tuple[Piece, ...] = ()


def read_log(mapping: Mapping, path: Path) -> Source:
    """Read the LCM log at `path` as the mapping specifies.

    Raises SourceError naming a missing channel and those present, or a clock that stands still; OSError if the file
    cannot be read.
    """
    with open_regular(path):
        pass  # LCM's own error does not say why a file cannot be opened
    source = Source({})
    gathered: dict[str, _Messages] = {}
    channels_present: set[str] = set()
    log = EventReader(path)
    with progress_of([log]) as progress:
        for event in reading(log, progress):
            channels_present.add(event.channel)
            channel = mapping.channels.get(event.channel)
            if channel is None:
                continue
            if len(event.data) == message_bytes(channel.layout):
                gathered.setdefault(event.channel, _Messages()).take(event)
            else:
                source.skipped[event.channel, "message of another length than the layout's"] += 1
    if log.damaged_bytes:
        source.notes.append(
            f"{path} is truncated or damaged: {log.damaged_bytes} bytes of it are no intact events; the rest is used."
        )
    for name in mapping.channels:
        if name not in gathered:
            why = "no message of the layout's length" if name in channels_present else "no such channel"
            raise SourceError(
                f"{path}: {name}: {why}; channels present: {', '.join(sorted(channels_present)) or 'none'}"
            )
    source.tables = _log_tables(mapping, gathered, source.skipped)
    require_moving_clocks(path, source.tables, "for a broken utime, map time: event_time")
    return source


def require_moving_clocks(path: Path, tables: dict[str, Table], hint: str) -> None:
    """Raise SourceError, ending with `hint`, if the time of a table stands still."""
    for name, table in tables.items():
        if len(table.utime) > 1 and table.utime[0] == table.utime[-1]:
            raise SourceError(f"{path}: the time of {name} stands still; {hint}")


class _Messages:
    """The messages of one channel, concatenated, and when each was logged [us]."""

    def __init__(self) -> None:
        self.arrivals = array("q")
        self.data = bytearray()

    def take(self, event: Event) -> None:
        self.arrivals.append(event.utime)
        self.data += event.data


def _log_tables(
    mapping: Mapping, gathered: dict[str, _Messages], skipped: Counter[tuple[str, str]]
) -> dict[str, Table]:
    """Decode the messages; all channels of a clock with a wrong offset are shifted equally, to keep them
    synchronised.
    """
    channels = mapping.channels
    arrivals = {name: np.frombuffer(gathered[name].arrivals, np.int64) for name in channels}
    # Decoded bytes are released.
    decoded = {
        name: decode(channel.layout, gathered.pop(name).data, {"utime", *mapping.columns(name)})
        for name, channel in channels.items()
    }
    # A message cannot arrive before it was stamped, so the smallest observed delay is the tightest bound on the shift.
    delays = [
        int((arrivals[name] - decoded[name]["utime"]).min())
        for name, channel in channels.items()
        if channel.clock == "shifted_utime"
    ]
    tables = {}
    for name, channel in channels.items():
        if channel.clock == "event_time":
            utime = arrivals[name]
        else:
            utime = decoded[name]["utime"] + (min(delays) if channel.clock == "shifted_utime" else 0)
        possible = (utime >= 0) & (utime < LATEST_UTIME)
        if not possible.all():
            skipped[name, "message of an impossible time"] += int((~possible).sum())
        columns = {column: values[possible] for column, values in decoded[name].items()}
        segment = np.zeros(int(possible.sum()), np.int64)
        tables[name] = in_time_order(utime[possible], arrivals[name][possible], segment, columns)
    return tables


def in_time_order(
    utime: NDArray[np.int64],
    received_utime: NDArray[np.int64],
    segment: NDArray[np.int64],
    columns: Dictionary[str, Column],
) -> Table:
    """Return the rows as a table, in the order of `utime`; rows of equal time keep their order."""
    order = np.argsort(utime, kind="stable")
    return Table(
        utime[order], received_utime[order], segment[order], {name: values[order] for name, values in columns.items()}
    )
