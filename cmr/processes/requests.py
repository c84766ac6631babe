"""Requests for processes on other machines: how cmr-run makes them, and how an agent reads them."""

import json
import re
import socket
import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from cmr.bus.messages import make
from cmr.msg import process_request_t
from cmr.processes.children import our_command
from cmr.processes.job import RECORDER, SIM, START_ORDER, Job

AGENT = "cmr-agent"  # on PROCESS_STATUS
RUN_FOLDER = "{run}"
RECORDER_PROGRAM = "cmr-run-recorder"  # not a command of its own
PROGRAMS = ("cmr-driver", "cmr-pilot", "cmr-emulate", "cmr-sim", "cmr-calibrate", "cmr-diagnose", RECORDER_PROGRAM)
RECORDER_MODULE = "cmr.experiments.live.recorder"
RECORDER_HERE = [sys.executable, "-m", RECORDER_MODULE]
RUN_NAME = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9._-]{0,79}")
PROCESS_NAME = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9 ._-]{0,79}")  # also the name of a file
FILE_NAME = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9._-]{0,80}\.yaml")
MOST_ARGUMENTS, MOST_FILES = 100, 500
LONGEST_ARGUMENT = 4_000  # characters; longer than any path, ...
LONGEST_FILE_NAME = 255  # bytes; ... the limit of one part of a path
LONGEST_NAME = 80  # characters
LARGEST = 300_000  # bytes of a request's files; larger ones are copied by hand


class RequestError(ValueError):
    """A request that cannot be met; the text says why."""


@dataclass(frozen=True)
class Request:
    """A requested process, as a job of this machine, and the texts of its files, by name.

    The files are in `folder`, like everything of the run.
    """

    run: str
    folder: Path
    wanted: bool
    job: Job
    files: Mapping[str, str]


def is_there(program: str) -> bool:
    """Return whether one of PROGRAMS is installed on this computer; a robot's own has only a few."""
    if program != RECORDER_PROGRAM:
        return Path(our_command(program)).exists()
    try:
        return find_spec(RECORDER_MODULE) is not None
    except ModuleNotFoundError:  # not even the package in which it is
        return False


def is_this_host(name: str) -> bool:
    """Return whether a scenario's host name is that of this machine."""
    return short_name(name) == short_name(socket.gethostname())


def short_name(host: str) -> str:
    """Return a host's name without its domain."""
    return host.partition(".")[0]


def requests_of(jobs: Iterable[Job], folder: Path, utime: int, wanted: bool) -> Iterator[process_request_t]:
    """Yield requests to agents on other machines for these processes of the run in `folder`."""
    for job in jobs:
        program = RECORDER_PROGRAM if job.role == RECORDER else Path(job.command[0]).name
        arguments = job.command[3:] if job.role == RECORDER else job.command[1:]
        yield make(
            process_request_t,
            utime=utime,
            wanted=wanted,
            once=job.once,
            host=job.host or "",
            run=_name_of(folder),
            name=job.name,
            role=job.role,
            command=json.dumps([program, *(_elsewhere(argument, folder) for argument in arguments)]),
            after="" if job.after is None else _elsewhere(str(job.after), folder),
            files=json.dumps(_files(job, folder) if wanted else {}),
        )


def read_request(message: process_request_t, base: Path) -> Request:
    """Parse a request, by a run that gets a folder in `base`.

    Raises RequestError if it is invalid.
    """
    if not RUN_NAME.fullmatch(message.run):
        raise RequestError("its run has no name that a folder can have")
    folder = base / message.run
    if not PROCESS_NAME.fullmatch(message.name):
        raise RequestError("it has no name that a file can have")
    command, files = _texts(_json(message.command)), _json(message.files)
    if not 0 < len(command) <= MOST_ARGUMENTS:
        raise RequestError("its command has no program, or too many arguments")
    if command[0] not in PROGRAMS:
        raise RequestError(f"{command[0]!r} is none of CMR's programs")
    if not all(map(_is_argument, (*command, message.after))):
        raise RequestError("an argument is too long, or none that a process can have")
    if max(len(part.encode()) for part in message.after.split("/")) > LONGEST_FILE_NAME:
        raise RequestError("it waits for a file that cannot be")
    if message.role not in START_ORDER:
        raise RequestError(f"{message.role!r} is nothing that a process is for")
    if not isinstance(files, dict) or len(files) > MOST_FILES or not all(map(FILE_NAME.fullmatch, files)):
        raise RequestError("its files are none of a run")
    if not all(map(_is_encodable, _texts(list(files.values())))):
        raise RequestError("its files are none of a run")
    if not is_there(command[0]):
        raise RequestError(f"{command[0]} is not installed on this computer")
    program = RECORDER_HERE if command[0] == RECORDER_PROGRAM else [our_command(command[0])]
    job = Job(
        message.name,
        message.role,
        [*program, *(argument.replace(RUN_FOLDER, str(folder)) for argument in command[1:])],
        after=Path(message.after.replace(RUN_FOLDER, str(folder))) if message.after else None,
        once=bool(message.once),
    )
    return Request(message.run, folder, bool(message.wanted), job, files)


def _json(text: str) -> object:
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise RequestError("it is no JSON") from error


def _texts(value: object) -> list[str]:
    if not isinstance(value, list) or not all(isinstance(each, str) for each in value):
        raise RequestError("it has something else in place of texts")
    return value


def _is_argument(text: str) -> bool:
    """Return whether a text can be a command-line argument."""
    return len(text) <= LONGEST_ARGUMENT and "\0" not in text and _is_encodable(text)


def _is_encodable(text: str) -> bool:
    """Return whether a text can be encoded; JSON may contain lone surrogates."""
    try:
        return bool(text.encode()) or not text
    except UnicodeEncodeError:
        return False


def _elsewhere(argument: str, folder: Path) -> str:
    """Return an argument with a placeholder for the run's folder if it refers to it."""
    path = Path(argument)
    return f"{RUN_FOLDER}/{path.relative_to(folder)}" if path.is_relative_to(folder) else argument


def _name_of(folder: Path) -> str:
    """Return the name of a run's folder in a form valid on other machines."""
    return re.sub("[^A-Za-z0-9_-]", "_", folder.resolve().name)[:LONGEST_NAME] or "run"


def _files(job: Job, folder: Path) -> dict[str, str]:
    """Return the files that a process reads: those in its command; all for cmr-sim, whose scenario refers to more."""
    named = {path for argument in job.command if (path := Path(argument)).parent == folder and path.suffix == ".yaml"}
    paths = folder.glob("*.yaml") if job.role == SIM else named
    texts = {path.name: path.read_text("utf-8") for path in sorted(paths) if path.is_file()}
    if sum(map(len, texts.values())) > LARGEST:
        return {}
    return texts
