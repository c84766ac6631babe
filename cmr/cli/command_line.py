"""The shared command-line behaviour of all cmr-* commands: help with an example, --version, exit codes, errors."""

import argparse
import json
import math
import os
import re
import sys
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from textwrap import fill
from typing import TextIO

from cmr.cli import configuration
from cmr.cli.configuration import DEFAULT_URL, LARGEST_ROBOT_ID
from cmr.cli.errors import CommandError, ExpectedError
from cmr.cli.news import be_quiet
from cmr.distribution import version
from cmr.files import NO_ROOM, why_not_writable
from cmr.plain_text import LINES, plain

EXIT_CODES = """\
exit codes:
  0    done
  1    failed, or something was found: one line on stderr says what, and what to do
  2    wrong usage
  130  interrupted by Ctrl-C, SIGTERM or SIGHUP"""
# Unprintable characters that JSON does not escape.
UNPRINTED = re.compile("[\x7f-\x9f\xad\u200b-\u200f\u2028-\u202e\u2060-\u2069\ufeff]")
HELP_WIDTH = 79  # characters; a terminal's usual 80 leave room for no more


class _HelpFormatter(argparse.ArgumentDefaultsHelpFormatter, argparse.RawDescriptionHelpFormatter):
    """Keeps the lines of examples, and shows meaningful defaults."""

    def _get_help_string(self, action: argparse.Action) -> str | None:
        said = action.help is not None and "(default: " in action.help
        if said or action.default in (None, []) or isinstance(action.default, bool):
            return action.help
        return super()._get_help_string(action)


JSON_HELP = "print the result as JSON, for programs"
USUAL_BUS = (
    "LCM bus; otherwise LCM_DEFAULT_URL from the environment, otherwise lcm_url of ~/.config/cmr/config.yaml, "
    f"otherwise {DEFAULT_URL} (this host only)"
)


def parser(name: str, description: str, example: str, bus: str = USUAL_BUS) -> argparse.ArgumentParser:
    """Return a parser with the options that every command has."""
    paragraphs = [fill(paragraph, HELP_WIDTH, break_on_hyphens=False) for paragraph in description.split("\n\n")]
    result = argparse.ArgumentParser(
        prog=name,
        description="\n\n".join(paragraphs),
        epilog=f"example:\n  {example}\n\n{EXIT_CODES}",
        formatter_class=_HelpFormatter,
    )
    _add_usual(result, bus, None)
    result.add_argument("--version", action=_Version, nargs=0, help="show program's version number and exit")
    return result


def usual_options(bus: str = USUAL_BUS) -> argparse.ArgumentParser:
    """Return the parent of subcommands' parsers, with --json and the common options."""
    result = argparse.ArgumentParser(add_help=False)
    _add_usual(result, bus, argparse.SUPPRESS)  # keep values given before the subcommand
    result.add_argument("--json", action="store_true", default=argparse.SUPPRESS, help=JSON_HELP)
    return result


def _add_usual(options: argparse.ArgumentParser, bus: str, default: str | None) -> None:
    options.add_argument("--lcm-url", default=default, metavar="URL", help=bus)
    options.add_argument(
        "--insecure",
        action=_Insecure,
        nargs=0,
        help="share the bus with other computers without a key: anybody on the network can drive the robots",
    )
    options.add_argument("--quiet", action=_Quiet, nargs=0, help="print errors and results only: no news, no progress")


class _Version(argparse.Action):
    """Prints the version; it is only looked up on demand, because that takes as long as the rest of a start."""

    def __call__(self, parser: argparse.ArgumentParser, *_arguments: object) -> None:
        print(f"{parser.prog} {version()}")
        parser.exit()


class _Insecure(argparse.Action):
    """Makes this process, and its children, accept unsigned messages."""

    def __call__(self, *_arguments: object) -> None:
        configuration.be_insecure()


class _Quiet(argparse.Action):
    """Disables news and progress in the whole program."""

    def __call__(self, *_arguments: object) -> None:
        be_quiet()


def check_writable(folder: Path) -> None:
    """Refuse a folder for results that cannot be created or written, before any long computation. Raises
    CommandError.
    """
    if why := why_not_writable(folder):
        raise CommandError(f"{folder}: cannot be written: {why}. Choose another place with --out.")


def add_robot(options: argparse.ArgumentParser) -> None:
    """Add the option for the robot; the default comes from the environment or the configuration file."""
    options.add_argument("--robot", type=parse_robot_id, default=configuration.robot(), metavar="N", help="robot id")


def add_begin_with(options: argparse.ArgumentParser, meanwhile: str) -> None:
    """Add the option for the program that starts the robots; `meanwhile` says what they do until then."""
    options.add_argument(
        "--begin-with",
        default="",
        metavar="PROGRAM",
        help=f"{meanwhile} until this program, such as cmr-run, reports on PROCESS_STATUS that it is ready",
    )


def add_nominal(options: argparse.ArgumentParser) -> None:
    """Add the option for the nominal parameters of an estimate."""
    options.add_argument(
        "--parameters",
        type=Path,
        default=None,
        metavar="FILE",
        help="nominal parameters, at least wheel_radius; otherwise those announced on PARAMETERS_N",
    )


def add_logs(options: argparse.ArgumentParser, what: str, single: bool = False) -> None:
    """Add event logs, or a single one, given as arguments or with --log; `logs_of` returns them."""
    options.add_argument("logs", type=Path, nargs="?" if single else "*", metavar="RUN.lcm", help=what)
    options.add_argument(
        "--log",
        type=Path,
        nargs=None if single else "+",
        action="store" if single else "extend",
        metavar="RUN.lcm",
        help="the same as RUN.lcm without --log",
    )


def logs_of(chosen: argparse.Namespace) -> list[Path]:
    """Return the logs given in either way."""
    logs: list[Path] = []
    for given in (chosen.logs, chosen.log):
        logs += [given] if isinstance(given, Path) else given or []
    return logs


def add_channels(options: argparse.ArgumentParser) -> None:
    """Add the option that chooses channels."""
    options.add_argument(
        "--channel",
        action="append",
        default=[],
        metavar="PATTERN",
        help="only channels that fit, such as 'POSE_*'; may be given again",
    )


def add_without(options: argparse.ArgumentParser) -> None:
    """Add the option that excludes channels."""
    options.add_argument(
        "--without",
        action="append",
        default=[],
        metavar="PATTERN",
        help="no channels that fit; may be given again",
    )


def add_json(options: argparse.ArgumentParser) -> None:
    """Add the option for results that programs read."""
    options.add_argument("--json", action="store_true", help=JSON_HELP)


def print_json(result: object, indent: int | None = 2) -> None:
    """Print a result for programs; non-finite numbers, which JSON does not have, become null.

    Without `indent` it is one line, flushed immediately.
    """
    text = json.dumps(_finite(result), indent=indent, ensure_ascii=False, default=str)
    print(UNPRINTED.sub(lambda found: f"\\u{ord(found[0]):04x}", text), flush=indent is None)


def _finite(value: object) -> object:
    """Return the value with None in place of every number that is not finite."""
    if isinstance(value, Mapping):
        return {str(key): _finite(one) for key, one in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def parse_count(text: str) -> int:
    """Parse a number of things for argparse: whole, 1 or more."""
    if not (text.isascii() and text.isdecimal() and int(text) > 0):
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number of 1 or more")
    return int(text)


def parse_robot_id(text: str) -> int:
    """Parse a robot id for argparse: a number that channel names and messages can hold."""
    if not (text.isascii() and text.isdecimal()) or int(text) > LARGEST_ROBOT_ID:
        raise argparse.ArgumentTypeError(f"a robot id is a whole number of 0 to {LARGEST_ROBOT_ID}, not {text!r}")
    return int(text)


def parse_seconds(text: str) -> float:
    """Parse a time for argparse: a finite number of seconds, 0 or more."""
    return parse_number(text, f"{text!r} is not a time: a number of 0 or more, in seconds", least=0.0)


def parse_number(
    text: str, otherwise: str, *, least: float = -math.inf, above: float = -math.inf, most: float = math.inf
) -> float:
    """Parse a finite number for argparse, of `least` to `most`, and greater than `above`.

    Raises argparse.ArgumentTypeError with the message `otherwise` if the text is invalid.
    """
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not (math.isfinite(number) and least <= number <= most and number > above):
        raise argparse.ArgumentTypeError(otherwise)
    return number


def _say_why_failed(sentence: str) -> None:
    try:
        print(f"{sys.argv[0].rsplit('/', 1)[-1]}: {plain(sentence, kept=LINES)}", file=sys.stderr, flush=True)
    except OSError:
        _say_nothing_more(sys.stderr)


def _say_nothing_more(stream: TextIO) -> None:
    """Discard all further output, including what is buffered."""
    with suppress(OSError, ValueError):  # not a system file, as in a notebook
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def guarded(main: Callable[[list[str]], int], arguments: list[str]) -> int:
    """Run `main`; turn expected errors, and a full disk, into one line on stderr and exit code 1.

    If nobody reads the output any more, as after `| head`, it ends silently.
    """
    try:
        code = main(arguments)
        sys.stdout.flush()
        return code
    except BrokenPipeError:
        _say_nothing_more(sys.stdout)
        return 1
    except ExpectedError as error:
        _say_why_failed(str(error))
        return 1
    except OSError as error:
        if error.errno not in NO_ROOM:
            raise
        where = f"{error.filename}: " if error.filename else ""
        _say_nothing_more(sys.stdout)  # it may be the file on the full disk
        _say_why_failed(f"{where}{error.strerror}. Free some space on that disk, then try again.")
        return 1
    except KeyboardInterrupt:
        return 130
