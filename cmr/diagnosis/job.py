"""One diagnosis from logs to files: its inputs, its outputs, and a short outcome."""

import hashlib
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from cmr.bus.streams import identify
from cmr.diagnosis.result import Against, Diagnosis
from cmr.estimation.estimates import EstimationError
from cmr.estimation.search.trace import Decision
from cmr.files import folder_for_results
from cmr.model.catalogue import learn
from cmr.model.laws import Law
from cmr.parameters.file import ParameterFile, ParameterFileError
from cmr.recordings.arrivals import KEPT
from cmr.recordings.events import EventReader
from cmr.recordings.recording import Recording, RecordingError, choose_robot, read_log

DOCUMENT, REPORT = "diagnosis.json", "report.html"
CHUNK = 1 << 20  # bytes of a log read at a time

Telling = Callable[[str], None]


class JobError(Exception):
    """The diagnosis cannot be made or written; the text says why and what to do."""


@dataclass(frozen=True, kw_only=True)
class Job:
    """The logs of one robot that are diagnosed together, and the folder for the results.

    `robot_id` None means the only robot of the logs, `nominal` None the announced parameters. With `against`, the file
    of `nominal`, differences from it are reported. `held_out` logs measure the gain. `report` says whether to write
    report.html. `laws` are tested by name, like effects.
    """

    logs: tuple[Path, ...]
    robot_id: int | None
    folder: Path
    nominal: ParameterFile | None = None
    against: Against | None = None
    held_out: tuple[Path, ...] = ()
    report: bool = True
    laws: tuple[Law, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """The outcome of a job: either `failure`, a sentence, or the verdict and the named effects.

    `ratio` is the gain in held-out path error, NaN where it is not known. `decisions` are the steps of the search.
    """

    folder: Path
    failure: str = ""
    verdict: str = ""
    effects: tuple[str, ...] = ()
    ratio: float = math.nan
    decisions: tuple[Decision, ...] = ()


def robots_in(log: Path) -> list[int]:
    """Return the ids of the robots in a log, from channel names only.

    Raises RecordingError when the log cannot be opened or holds no robot.
    """
    _filled(log)
    status = log.stat()
    channels = _channels_in(log, status.st_size, status.st_mtime_ns)
    measuring = [kept.stream for kept in KEPT.values() if kept.measured]
    identities = [identify(channel) for channel in channels]
    robots = sorted({found[1] for found in identities if found and found[0] in measuring and found[1] is not None})
    return robots or [choose_robot({}, None, str(log))]


@lru_cache(maxsize=256)
def _channels_in(log: Path, _size: int, _written: int) -> frozenset[str]:
    """Return the names of the channels in a log of this size [bytes], last written at this time [ns]."""
    return frozenset(event.channel for event in EventReader(log))


def _filled(log: Path) -> None:
    """Raise RecordingError when a log cannot be opened or is empty; with the reason."""
    read_log(log)
    if log.is_file() and log.stat().st_size == 0:
        raise RecordingError(f"{log}: is empty. Was lcm-logger on the robot's bus (--lcm-url) during the drive?")


def perform(job: Job, tell: Telling) -> tuple[Diagnosis, tuple[Path, ...]]:
    """Read, diagnose and write; return the diagnosis and the written files. `tell` receives sentences on progress.

    Raises JobError.
    """
    with ExitStack() as made:
        with _writing(job.folder):  # fail before the work, not after it
            made.enter_context(folder_for_results(job.folder))
        return _perform(job, tell)


def _perform(job: Job, tell: Telling) -> tuple[Diagnosis, tuple[Path, ...]]:
    # The engine takes a while to load; errors in the command line should be reported before.
    from cmr.diagnosis.diagnose import diagnose

    for law in job.laws:  # worker processes do not know them yet
        learn(law)
    try:
        tell(f"Reading {_names(job.logs)}.")
        for log in (*job.logs, *job.held_out):
            _filled(log)
        recordings = [Recording.read(log, job.robot_id) for log in job.logs]
        _check_against(job, recordings[0].robot_id)
        held_out = [Recording.read(log, recordings[0].robot_id) for log in job.held_out]
        diagnosis = diagnose(
            recordings,
            job.nominal,
            against=job.against,
            held_out=held_out,
            sources=[str(log) for log in job.logs],
            held_out_sources=[str(log) for log in job.held_out],
            laws=job.laws,
            progress=tell,
        )
        provenance = _provenance(job, diagnosis.sources)
    except (RecordingError, EstimationError) as error:
        raise JobError(str(error)) from error
    with _writing(job.folder):
        return diagnosis, _write(diagnosis, job, provenance, tell)


def _check_against(job: Job, robot_id: int) -> None:
    """Raise JobError if the file belongs to another robot."""
    if job.against is not None and job.nominal is not None and job.nominal.robot_id != robot_id:
        raise JobError(
            f"{job.against.source} is of robot {job.nominal.robot_id}, the log of robot {robot_id}: only the same "
            "robot can be compared. Choose the robot's own file, or correct robot_id in it."
        )


def attempt(job: Job, tell: Telling) -> Outcome:
    """Do the job and return its outcome in any case, so that other jobs continue."""
    try:
        diagnosis, _files = perform(job, tell)
    except JobError as error:
        return Outcome(folder=job.folder, failure=str(error))
    except Exception as error:
        what = f"unexpected {type(error).__name__}: {error}"
        return Outcome(folder=job.folder, failure=f"{what}. Diagnose {_names(job.logs)} alone for details.")
    return Outcome(
        folder=job.folder,
        verdict=diagnosis.verdict,
        effects=tuple(effect.name for effect in diagnosis.effects),
        ratio=diagnosis.gain.ratio if diagnosis.gain else math.nan,
        decisions=diagnosis.decisions,
    )


@contextmanager
def _writing(folder: Path) -> Iterator[None]:
    """Convert errors in writing to JobError."""
    try:
        yield
    except ParameterFileError as error:
        raise JobError(f"The extended parameters cannot be written: {error}") from error
    except OSError as error:
        why = "it is a file, not a folder" if folder.is_file() else error.strerror or error
        what = f"{folder}: cannot be written: {why}"
        raise JobError(f"{what}. Choose another place with --out.") from error


def _write(diagnosis: Diagnosis, job: Job, provenance: dict[str, object], tell: Telling) -> tuple[Path, ...]:
    """Write the applicable files; unusable data have no parameters. The report comes last, as it is the most likely to
    fail.
    """
    from cmr.diagnosis.document import extended_file, write_document

    files = [job.folder / DOCUMENT]
    write_document(diagnosis, files[0])
    if diagnosis.extended is not None:
        files.append(job.folder / f"robot_{diagnosis.robot_id}.yaml")
        extended_file(diagnosis, provenance).save(files[-1])
    if job.report:
        from cmr.diagnosis.report import write_report

        tell("Writing the report.")
        files.append(job.folder / REPORT)
        write_report(diagnosis, files[-1])
    return tuple(files)


def _provenance(job: Job, sources: Sequence[str]) -> dict[str, object]:
    """Return the origin of the parameters: the usable logs of the job."""
    fitted = [log for log in job.logs if str(log) in sources]
    digest = hashlib.sha256()
    for log in fitted:
        with log.open("rb") as stream:
            for chunk in iter(lambda: stream.read(CHUNK), b""):
                digest.update(chunk)
    provenance = {"log": _names(fitted), "sha256": digest.hexdigest()}
    return {**provenance, **({"held_out_log": _names(job.held_out)} if job.held_out else {})}


def _names(logs: Sequence[Path]) -> str:
    return " ".join(str(log) for log in logs)
