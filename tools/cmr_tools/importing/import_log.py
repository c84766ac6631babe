"""cmr-import: convert measured data of other robots to event logs.

Usage: cmr-import MAPPING INPUT [INPUT ...] --out RUN.lcm or FOLDER, or cmr-import --list
"""

import argparse
import shlex
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from glob import has_magic
from pathlib import Path

from cmr.cli.command_line import parse_robot_id, parser
from cmr.cli.errors import CommandError
from cmr.files import folder_for_results
from cmr.model.parameters import DEFINITIONS
from cmr.parameters.file import ParameterFileError
from cmr.parameters.file import load as load_parameters
from cmr_tools.importing import mapping as mappings
from cmr_tools.importing.block import MappingError
from cmr_tools.importing.converting import ConversionError
from cmr_tools.importing.inputs import Recorded, logs_of, paths_of, recorded
from cmr_tools.importing.mapping_types import Mapping
from cmr_tools.importing.ros_records import BagError
from cmr_tools.importing.sources import SourceError
from cmr_tools.importing.transcribing import Imported, import_recording

LARGEST_ROBOT_ID = 999_999_999  # nine digits, the limit in channel names


def main(arguments: list[str]) -> int:
    """Import recordings, or list the shipped mappings.

    Raises CommandError if the mapping, an output or a recording cannot be used; of several recordings, all usable ones
    are imported first.
    """
    options = _parse(arguments)
    if options.list:
        print("\n".join(_list()))
        return 0
    mapping = _mapping(options.mapping, options.parameters)
    paths = paths_of(options.input)
    out = Path(options.out)
    if len(paths) > 1 or has_magic(options.input[0]) or out.is_dir() or options.out.endswith("/"):
        _import_all(mapping, paths, out, options.robot)
    else:
        imported = _import(mapping, _recorded(mapping, paths[0]), out, options.robot)
        print("\n".join([imported.headline(), *imported.channels(), *imported.remarks(), _next(imported)]))
    return 0


def command_parser() -> argparse.ArgumentParser:
    """Return the command line of cmr-import."""
    command_line = parser(
        "cmr-import",
        "Turn recordings of another robot (foreign LCM logs, CSV files, ROS 1 or ROS 2 bags, MCAP) into event logs "
        "of ours, by a mapping file.",
        "cmr-import mbot drive_square.log --out run.lcm && cmr-calibrate --log run.lcm\n"
        "  cmr-import optiodom 'data/**/*_run-??.csv' --out logs/",
        bus="accepted as by every command; an import needs no bus",
    )
    command_line.add_argument("mapping", nargs="?", help="name of a shipped mapping, or path of a mapping file")
    command_line.add_argument(
        "input",
        nargs="*",
        help="the recordings: an LCM log, .csv, .csv.gz, .bag, .mcap, .db3, or the folder of a bag or of the CSV files "
        "of one recording; patterns such as 'runs/*.csv' and '**' are resolved",
    )
    command_line.add_argument(
        "--out",
        metavar="RUN.lcm",
        help="the event log to write, replaced if it is there; or a folder, where there are several recordings or it "
        "ends in /: each log has its recording's name there, and lies as the recordings lie below what they share",
    )
    command_line.add_argument("--robot", type=parse_robot_id, default=0, metavar="N", help="id of the robot in the log")
    command_line.add_argument(
        "--parameters", metavar="FILE", help="the robot's nominal parameters, in place of those in the mapping"
    )
    command_line.add_argument("--list", action="store_true", help="list the shipped mappings and end")
    return command_line


def _parse(arguments: Sequence[str]) -> argparse.Namespace:
    command_line = command_parser()
    options = command_line.parse_args(arguments)
    if not options.list and (options.mapping is None or not options.input or options.out is None):
        command_line.error("MAPPING, INPUT and --out are needed; or --list")
    if not 0 <= options.robot <= LARGEST_ROBOT_ID:
        command_line.error(f"--robot must be 0 to {LARGEST_ROBOT_ID}, not {options.robot}")
    return options


def _list() -> list[str]:
    names = mappings.shipped()
    width = max(map(len, names))
    return [f"{name:{width}}  {mappings.load(name).about}" for name in names]


def _mapping(name: str, parameters: str | None) -> Mapping:
    """Return the mapping, with the nominal parameters replaced by the paper's parameters of a parameter file, if
    given.
    """
    try:
        values = {} if parameters is None else load_parameters(Path(parameters)).values
        return mappings.load(name, {key: one.value for key, one in values.items() if key in DEFINITIONS})
    except (MappingError, ParameterFileError) as error:
        raise CommandError(str(error)) from error


def _recorded(mapping: Mapping, path: Path) -> Recorded:
    try:
        return recorded(mapping, path)
    except (BagError, SourceError) as error:
        raise CommandError(str(error)) from error
    except OSError as error:
        raise CommandError(f"{error.filename or path}: {error.strerror or error}") from error


def _import(mapping: Mapping, recording: Recorded, out: Path, robot_id: int) -> Imported:
    if out.exists() and any(out.samefile(file) for file in recording.files.values() if file.exists()):
        raise CommandError(f"{out} is the recording itself; name another file with --out")
    try:
        return import_recording(mapping, recording, out, robot_id)
    except (BagError, SourceError, ConversionError) as error:
        raise CommandError(str(error)) from error
    except OSError as error:
        raise CommandError(f"{error.filename or out}: {error.strerror or error}") from error


def _import_all(mapping: Mapping, paths: Sequence[Path], folder: Path, robot_id: int) -> None:
    """Import the recordings into the folder, as far as possible; failures are reported on stderr in turn."""
    recordings: dict[tuple[Path, ...], Recorded] = {}
    failed = 0
    for path in paths:
        try:
            recording = _recorded(mapping, path)
            recordings.setdefault(tuple(recording.files.values()), recording)
        except CommandError as error:
            failed += _said(error)
    total = failed + len(recordings)
    logs = logs_of(list(recordings.values()), folder)
    for recording, log in zip(recordings.values(), logs, strict=True):
        with _made(log.parent):
            try:
                imported = _import(mapping, recording, log, robot_id)
                print("\n".join([imported.headline(), *imported.remarks()]), flush=True)
            except CommandError as error:
                failed += _said(error)
    if failed:
        raise CommandError(f"{failed} of {total} recordings could not be imported; why is said above")
    print(_next_of_all(logs, robot_id))


@contextmanager
def _made(folder: Path) -> Iterator[None]:
    with ExitStack() as made:
        try:
            made.enter_context(folder_for_results(folder))
        except OSError as error:
            raise CommandError(f"{folder}: {error.strerror}; for several recordings --out must be a folder") from error
        yield


def _said(error: CommandError) -> int:
    """Print on stderr why a recording cannot be imported; return True."""
    print(f"cmr-import: {error}", file=sys.stderr, flush=True)
    return 1


def _next(imported: Imported) -> str:
    return f"next: cmr-calibrate --log {imported.out}{_robot_option(imported.robot_id)}"


def _next_of_all(logs: Sequence[Path], robot_id: int) -> str:
    folders = dict.fromkeys(shlex.quote(str(log.parent)) for log in logs)
    named = " ".join(f"{folder}/*.lcm" for folder in folders)
    return f"next: cmr-diagnose {named}{_robot_option(robot_id)} --out diagnosis"


def _robot_option(robot_id: int) -> str:
    return f" --robot {robot_id}" if robot_id else ""
