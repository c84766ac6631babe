"""cmr-import: turn measured data of other robots into our event logs.

Usage: cmr-import MAPPING INPUT --out RUN.lcm, or cmr-import --list
"""

import argparse
import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from cmr.commands.command_line import CommandError, parse_robot_id, parser
from cmr.tools import mapping as mappings
from cmr.tools.block import MappingError
from cmr.tools.converting import Conversion, ConversionError, convert
from cmr.tools.mapping import Mapping
from cmr.tools.ros_files import files_of
from cmr.tools.ros_records import BagError
from cmr.tools.ros_source import read_bag
from cmr.tools.sources import MICROSECONDS, Source, SourceError, read
from cmr.tools.writing import write_log

PIECE_BYTES = 1 << 20
LARGEST_ROBOT_ID = 999_999_999  # nine digits: what channel names are read with


def main(arguments: list[str]) -> int:
    """Import one recording, or list the shipped mappings.

    Raises CommandError when mapping, recording or output cannot be used.
    """
    options = _parse(arguments)
    if options.list:
        print("\n".join(_list()))
        return 0
    recording, out = Path(options.input), Path(options.out)
    try:
        mapping = mappings.load(options.mapping)
        files = files_of(recording) if mapping.topics else [recording]
        if out.exists() and any(out.samefile(file) for file in files):
            raise CommandError(f"{out} is the recording itself; name another file with --out")
        source = read_bag(mapping, recording) if mapping.topics else read(mapping, recording)
        conversion = convert(mapping, source, options.robot, _provenance(mapping, recording, files))
        write_log(out, conversion, options.robot)
    except (MappingError, BagError, SourceError, ConversionError) as error:
        raise CommandError(str(error)) from error
    except OSError as error:
        raise CommandError(f"{error.filename or out}: {error.strerror or error}") from error
    print("\n".join(_summary(conversion, source, options.robot, out)))
    return 0


def _parse(arguments: Sequence[str]) -> argparse.Namespace:
    command_line = parser(
        "cmr-import",
        "Turn a recording of another robot (a foreign LCM log, CSV, a ROS 1 or ROS 2 bag, or MCAP) into an event log "
        "of ours, by a mapping file.",
        "cmr-import mbot drive_square.log --out run.lcm && cmr-calibrate --log run.lcm",
        bus="accepted as by every command; an import needs no bus",
    )
    command_line.add_argument("mapping", nargs="?", help="name of a shipped mapping, or path of a mapping file")
    command_line.add_argument(
        "input",
        nargs="?",
        help="the recording: an LCM log, .csv, .csv.gz, .bag, .mcap, .db3, or the folder of a bag",
    )
    command_line.add_argument("--out", metavar="RUN.lcm", help="the event log to write; replaced if it is there")
    command_line.add_argument("--robot", type=parse_robot_id, default=0, metavar="N", help="id of the robot in the log")
    command_line.add_argument("--list", action="store_true", help="list the shipped mappings and end")
    options = command_line.parse_args(arguments)
    if not options.list and None in (options.mapping, options.input, options.out):
        command_line.error("MAPPING, INPUT and --out are needed; or --list")
    if not 0 <= options.robot <= LARGEST_ROBOT_ID:
        command_line.error(f"--robot must be 0 to {LARGEST_ROBOT_ID}, not {options.robot}")
    return options


def _list() -> list[str]:
    names = mappings.shipped()
    width = max(map(len, names))
    return [f"{name:{width}}  {mappings.load(name).about}" for name in names]


def _provenance(mapping: Mapping, recording: Path, files: Sequence[Path]) -> dict[str, Any]:
    """Return where the nominal parameters and the log come from, and what is needed to undo the mapping."""
    provenance: dict[str, Any] = {
        "method": "nominal",
        "mapping": mapping.name,
        "log": recording.name or recording.resolve().name,
        "sha256": _digest(files),
    }
    if mapping.feedback is not None:
        provenance["ticks_per_turn"] = mapping.feedback.ticks_per_turn
    if mapping.command is not None and mapping.command.full_scale is not None:
        provenance["full_scale_rad_s"] = mapping.command.full_scale
    return provenance


def _digest(files: Sequence[Path]) -> str:
    """Return the SHA-256 of the files' bytes, one after the other."""
    digest = hashlib.sha256()
    for file in files:
        with file.open("rb") as stream:
            while piece := stream.read(PIECE_BYTES):
                digest.update(piece)
    return digest.hexdigest()


def _summary(conversion: Conversion, source: Source, robot_id: int, out: Path) -> list[str]:
    """Return what a person wants to know: what came out, what was left out, what to do next."""
    times = conversion.times()
    start, end = int(times[0][1][0]), max(int(utimes[-1]) for _, utimes in times)
    count = sum(len(utimes) for _, utimes in times)
    lines = [f"{out}: {count} messages over {(end - start) / MICROSECONDS:.1f} s"]
    for stream, utimes in times:
        first, last = (int(utime - start) / MICROSECONDS for utime in (utimes[0], utimes[-1]))
        lines.append(f"  {stream.channel(robot_id):20} {len(utimes):7}  from {first:8.2f} s to {last:8.2f} s")
    lines += [f"  skipped, {place}: {count} x {reason}" for (place, reason), count in sorted(source.skipped.items())]
    lines += [f"  note: {note}" for note in source.notes]
    robot = f" --robot {robot_id}" if robot_id else ""
    return [*lines, f"next: cmr-calibrate --log {out}{robot}"]
