"""Convert one foreign recording to a log."""

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from cmr.bus.messages import MICROSECONDS
from cmr.recordings.log_file import LogFile
from cmr_tools.importing.converting import Conversion, ConversionError, Event, convert
from cmr_tools.importing.csv_source import read_csv
from cmr_tools.importing.inputs import Recorded
from cmr_tools.importing.mapping_types import Mapping
from cmr_tools.importing.ros_source import read_bag
from cmr_tools.importing.sources import Source, read_log
from cmr_tools.writing import complete_or_none

PIECE_BYTES = 1 << 20


@dataclass(frozen=True)
class Imported:
    """Result of an import: the recording's messages, how it was read, and the log written."""

    conversion: Conversion
    source: Source
    robot_id: int
    out: Path

    def headline(self) -> str:
        """Return a summary of the log."""
        times = self.conversion.times()
        start, end = int(times[0][1][0]), max(int(utimes[-1]) for _, utimes in times)
        count = sum(len(utimes) for _, utimes in times)
        pieces = f", in {len(self.source.pieces)} pieces" if self.source.pieces else ""
        return f"{self.out}: {count} messages over {(end - start) / MICROSECONDS:.1f} s{pieces}"

    def channels(self) -> list[str]:
        """Return the contents of each channel, a line each."""
        times = self.conversion.times()
        start = int(times[0][1][0])
        lines = []
        for stream, utimes in times:
            first, last = (int(utime - start) / MICROSECONDS for utime in (utimes[0], utimes[-1]))
            channel = stream.channel(self.robot_id)
            lines.append(f"  {channel:20} {len(utimes):7}  from {first:8.2f} s to {last:8.2f} s")
        return lines

    def remarks(self) -> list[str]:
        """Return what was skipped, and other remarks for the user, a line each."""
        skipped = sorted(self.source.skipped.items())
        lines = [f"  skipped, {place}: {count} x {reason}" for (place, reason), count in skipped]
        return lines + [f"  note: {note}" for note in self.source.notes]


def import_recording(mapping: Mapping, recording: Recorded, out: Path, robot_id: int) -> Imported:
    """Write the log of a recording; it gets its name when it is complete.

    Raises BagError, SourceError or ConversionError if the recording cannot be used, OSError if a file cannot.
    """
    if mapping.topics:
        source = read_bag(mapping, recording.path)
    elif mapping.channels:
        source = read_log(mapping, recording.path)
    else:
        source = read_csv(mapping, recording.files)
    try:
        conversion = convert(mapping, source, robot_id, _provenance(mapping, recording, source))
    except ConversionError as error:
        raise ConversionError(" ".join((f"{error}.", *source.notes)) if source.notes else str(error)) from error
    write_log(out, conversion, robot_id)
    return Imported(conversion, source, robot_id, out)


def _provenance(mapping: Mapping, recording: Recorded, source: Source) -> dict[str, object]:
    """Return the origin of the nominal parameters and the log, and the data needed to invert the mapping.

    `pieces` says where the import set pieces of the recording apart: for each the utime [us] at which it begins, its
    name in the recording, and the recording's own time [s] there.
    """
    provenance: dict[str, object] = {
        "method": "nominal",
        "mapping": mapping.name,
        "log": recording.path.name or recording.path.resolve().name,
        "sha256": _digest(list(recording.files.values())),
    }
    if mapping.feedback is not None:
        provenance["ticks_per_turn"] = mapping.feedback.ticks_per_turn
    if mapping.command is not None and mapping.command.full_scale is not None:
        provenance["full_scale_rad_s"] = mapping.command.full_scale
    if source.pieces:
        provenance["pieces"] = [[piece.utime, piece.name, piece.seconds] for piece in source.pieces]
    return provenance


def _digest(files: Sequence[Path]) -> str:
    """Return the SHA-256 of the files' bytes, one after the other."""
    digest = hashlib.sha256()
    for file in files:
        with file.open("rb") as stream:
            while piece := stream.read(PIECE_BYTES):
                digest.update(piece)
    return digest.hexdigest()


def write_log(path: Path, events: Iterable[Event], robot_id: int) -> None:
    """Write the messages as an LCM event log, each logged at its own utime, in the given order.

    The log appears under its name when it is complete, in place of one that was there. Raises OSError when the
    folder cannot be written, KeyboardInterrupt on SIGINT or SIGTERM.
    """
    with complete_or_none(path) as temporary, LogFile(temporary) as log:
        for event in events:
            log.write(event.message.utime, event.stream.channel(robot_id), event.message.encode())
