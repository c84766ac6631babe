"""cmr-log: inspect event logs, cut and merge them, and convert their messages to other formats.

Usage: cmr-log info LOG..., or cut, merge, csv, parquet, mcap; see cmr-log COMMAND --help
"""

import argparse
import math
import resource
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

from cmr.cli.command_line import (
    add_channels,
    add_json,
    add_logs,
    add_without,
    logs_of,
    parse_seconds,
    parser,
    print_json,
    usual_options,
)
from cmr.cli.errors import CommandError
from cmr.distribution import how_to_install
from cmr.recordings.events import EventReader
from cmr_tools.events import channel_chooser, damage_sentence, open_log, progress_of, reading
from cmr_tools.logs.tables import Sink

NO_BUS = "accepted as by every command; logs need no bus"


class Done(NamedTuple):
    """Result of a subcommand: for programs, and in lines for the user."""

    document: dict[str, object]
    lines: list[str]


Work = Callable[[argparse.Namespace], Done]


def main(arguments: list[str]) -> int:
    """Run cmr-log.

    Raises CommandError if a log cannot be read or the result cannot be written.
    """
    options = _parse(arguments)
    try:
        done = options.work(options)
    except OSError as error:
        raise CommandError(f"{error.filename or options.out}: {error.strerror or error}") from error
    if options.json:
        print_json(done.document)
    else:
        print("\n".join(done.lines))
    return 0


def _parse(arguments: list[str]) -> argparse.Namespace:
    options = command_parser().parse_args(arguments)
    is_single, options.logs = not isinstance(options.logs, list), logs_of(options)
    if not options.logs or (is_single and len(options.logs) > 1):
        options.command.error(f"name {'one' if is_single else 'an'} event log")
    return options


def _info(options: argparse.Namespace) -> Done:
    from cmr_tools.logs.info import LogHealth
    from cmr_tools.logs.report import document, report

    documents, reports = [], []
    for path in options.logs:
        log, health = open_log(path), LogHealth()
        with progress_of([log]) as progress:
            health.take_all(reading(log, progress))
        documents.append(document(log, health))
        reports.append("\n".join(report(log, health)))
    return Done({"logs": documents}, ["\n\n".join(reports)])


def _cut(options: argparse.Namespace) -> Done:
    from cmr_tools.logs.cut import cut, write_events

    if not options.start < options.stop:
        raise CommandError(f"--stop {options.stop:g} is no later than --start {options.start:g}")
    log = open_log(options.logs[0])
    _check_out([log], options.out)
    with progress_of([log]) as progress:
        is_chosen = channel_chooser(options.channel, options.without)
        events = cut(reading(log, progress), options.start, options.stop, is_chosen)
        count = write_events(options.out, events)
    if count == 0:
        raise CommandError(f"{log.path}: no event lies there. What is in the log: cmr-log info {log.path}")
    return _written({options.out: count}, "events", [], [log])


def _merge(options: argparse.Namespace) -> Done:
    from cmr_tools.logs.cut import merge, write_events

    logs = [open_log(path) for path in options.logs]
    _check_out(logs, options.out)
    with progress_of(logs) as progress:
        count = write_events(options.out, merge([reading(log, progress) for log in logs]))
    if count == 0:
        raise CommandError("none of these files holds an event. Are they event logs, as lcm-logger writes them?")
    return _written({options.out: count}, "events", [], logs)


def _csv(options: argparse.Namespace) -> Done:
    from cmr_tools.logs.tables import CsvFile

    return _tables(options, "csv", CsvFile)


def _parquet(options: argparse.Namespace) -> Done:
    from cmr_tools.logs.tables import ParquetFile

    _allow_many_open_files()
    try:
        return _tables(options, "parquet", ParquetFile)
    except ModuleNotFoundError as error:
        raise _missing(error, "Parquet files", "sweep") from error


def _tables(options: argparse.Namespace, suffix: str, sink: Callable[[Path], Sink]) -> Done:
    """Write a file for each channel into the folder of --out."""
    from cmr_tools.logs.tables import TableWriter
    from cmr_tools.writing import complete_files_or_none

    log, folder = open_log(options.logs[0]), options.out
    is_chosen = channel_chooser(options.channel, options.without)
    with ExitStack() as stack:
        partial = stack.enter_context(complete_files_or_none(folder))
        progress = stack.enter_context(progress_of([log]))
        writer = stack.enter_context(TableWriter(lambda channel: sink(partial / f"{channel}.{suffix}")))
        writer.take_all(event for event in reading(log, progress) if is_chosen(event.channel))
    if not writer.rows:
        raise CommandError(f"{log.path}: {_nothing(writer.left_out.sentences())}")
    rows = {folder / f"{name}.{suffix}": rows for name, rows in sorted(writer.rows.items())}
    return _written(rows, "rows", writer.left_out.sentences(), [log])


def _mcap(options: argparse.Namespace) -> Done:
    from cmr_tools.logs.mcap import McapWriter
    from cmr_tools.writing import complete_or_none

    log = open_log(options.logs[0])
    _check_out([log], options.out)
    is_chosen = channel_chooser(options.channel, options.without)
    try:
        with complete_or_none(options.out) as temporary, temporary.open("wb") as stream:
            writer = McapWriter(stream)
            with progress_of([log]) as progress:
                writer.take_all(event for event in reading(log, progress) if is_chosen(event.channel))
            writer.finish()
            if writer.count == 0:
                raise CommandError(f"{log.path}: {_nothing(writer.left_out.sentences())}")
    except ModuleNotFoundError as error:
        raise _missing(error, "MCAP files", "log") from error
    return _written({options.out: writer.count}, "messages", writer.left_out.sentences(), [log])


def _written(files: Mapping[Path, int], unit: str, left_out: Sequence[str], logs: Sequence[EventReader]) -> Done:
    """Return the result: the number of `unit` in each file, what was left out, and the damage found."""
    damage = [sentence for log in logs if (sentence := damage_sentence(log))]
    written = [{"path": path, unit: count} for path, count in files.items()]
    lines = [f"{path}: {count} {unit}" for path, count in files.items()]
    return Done({"written": written, "left_out": left_out, "damage": damage}, [*lines, *left_out, *damage])


def _nothing(left_out: Sequence[str]) -> str:
    """Return the message that nothing was written, with the reason."""
    return " ".join(["no message of CMR could be decoded on the channels chosen; nothing is written.", *left_out])


def _missing(error: ModuleNotFoundError, what: str, extra: str) -> CommandError:
    return CommandError(f"{error.name} is missing, which {what} need. To install it: {how_to_install(extra)}")


def _check_out(logs: Sequence[EventReader], out: Path) -> None:
    """Raise CommandError if the result has no folder, or would replace a log that is being read."""
    if not out.parent.is_dir():
        raise CommandError(f"{out.parent} is no folder. Make it, or name another file with --out")
    if out.is_dir():
        raise CommandError(f"{out} is a folder; name a file with --out")
    if out.exists() and any(out.samefile(log.path) for log in logs):
        raise CommandError(f"{out} is the log itself; name another file with --out")


def _allow_many_open_files() -> None:
    """Raise the limit of open files to the system's maximum: one file per channel is needed."""
    _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))


def command_parser() -> argparse.ArgumentParser:
    """Return the command line of cmr-log."""
    options = parser(
        "cmr-log",
        "Look at event logs: what is in them and how healthy they are, pieces of them, and their messages in other "
        "formats. Of a damaged log the intact events are read, and the rest is counted.",
        "cmr-log info run.lcm",
        bus=NO_BUS,
    )
    add_json(options)
    commands = options.add_subparsers(metavar="COMMAND", required=True)

    def add(name: str, work: Work, purpose: str, example: str) -> argparse.ArgumentParser:
        command = commands.add_parser(
            name,
            help=purpose[0].lower() + purpose[1:],
            description=f"{purpose}.",
            epilog=f"example:\n  cmr-log {name} {example}",
            formatter_class=options.formatter_class,
            parents=[usual_options(NO_BUS)],
        )
        command.set_defaults(command=command, work=work, out=None)
        return command

    info = add("info", _info, "Show what is in logs and how healthy it is", "run.lcm")
    add_logs(info, "an event log")
    _add_pieces(add)
    _add_formats(add)
    return options


def _add_pieces(add: Callable[[str, Work, str, str], argparse.ArgumentParser]) -> None:
    """Add the commands that write event logs."""
    cut = add("cut", _cut, "Write a piece of a log", "run.lcm --start 10 --stop 20 --channel 'GYRO_*' --out piece.lcm")
    add_logs(cut, "an event log", single=True)
    cut.add_argument(
        *("--start", "--from"),
        type=parse_seconds,
        default=0.0,
        metavar="S",
        help="where to begin, from the beginning of the log",
    )
    cut.add_argument(
        *("--stop", "--to"),
        type=parse_seconds,
        default=math.inf,
        metavar="S",
        help="where to end, from the beginning of the log; what was logged then is left out",
    )
    _add_channel_and_out(cut, "X.lcm", "the piece")
    merge = add("merge", _merge, "Write several logs as one, by time", "a.lcm b.lcm --out both.lcm")
    add_logs(merge, "an event log")
    merge.add_argument("--out", type=Path, required=True, metavar="X.lcm", help="the log of all events")


def _add_formats(add: Callable[[str, Work, str, str], argparse.ArgumentParser]) -> None:
    """Add the commands that write other formats."""
    for name, work, purpose, out in (
        ("csv", _csv, "Write a CSV file for each channel, with units in the names of its columns", "DIR"),
        ("parquet", _parquet, "Write a Parquet file for each channel, as csv does", "DIR"),
        ("mcap", _mcap, "Write messages as MCAP with JSON, for Foxglove", "X.mcap"),
    ):
        convert = add(name, work, purpose, f"run.lcm --out {'run.mcap' if name == 'mcap' else 'tables'}")
        add_logs(convert, "an event log", single=True)
        _add_channel_and_out(convert, out, "a folder for the files" if out == "DIR" else "the file")


def _add_channel_and_out(command: argparse.ArgumentParser, out: str, what: str) -> None:
    add_channels(command)
    add_without(command)
    command.add_argument("--out", type=Path, required=True, metavar=out, help=what)
