"""Track the newest parameters of a robot, from whatever source: a calibrator, an editor, another host."""

import time
from dataclasses import replace
from pathlib import Path

from cmr.bus.message import Message
from cmr.bus.messages import now_utime
from cmr.bus.streams import PARAMETERS
from cmr.files import read_text
from cmr.msg import parameters_t
from cmr.parameters.file import ParameterFile, ParameterFileError, announcement, parse, sha256_of
from cmr.parameters.versions import Versions
from cmr.plain_text import plain

POLL_PERIOD = 0.2  # s; a replaced file is in use well within a second
LONGEST_PROBLEM = 200  # characters, each second on the bus
COSTLY = 0.01  # s; after a refused announcement that took longer, or was ...
LONG = 20_000  # ... characters long, ten times a usual one, ...
REST, LONGEST_REST = 10.0, 1.0  # none is read for this multiple of that time, and at most this many seconds


class ParameterFollower:
    """The parameters of one robot in use by a process.

    They come from the file at `path` (None: none) and from announcements on PARAMETERS_N; the newest wins. Without a
    file they are those of `default`, which are not announced; `by_default` is then true. `sequence` is the version in
    use: the time (us) at which it was written. Invalid parameters change nothing: `message` says why, until the file is
    repaired or a valid announcement arrives.
    """

    def __init__(self, robot_id: int, path: Path | None = None, default: ParameterFile | None = None) -> None:
        self.robot_id = robot_id
        self.path = path
        self.parameters: ParameterFile | None = None
        self.sha256 = ""
        self.sequence = 0
        self._file_problem = ""
        self._content_problem = ""  # of the file as last read; it may be missing or unreadable now
        self._announcement_problem = ""
        self.by_default = False
        self._versions = Versions()
        self._rests_until = 0.0
        self._seen: tuple[int, int, int] | None = None
        self._text = ""
        self._poll_due = 0.0
        self._started = False
        self.poll()
        self._started = True
        self.by_default = default is not None and self.parameters is None and path is not None and not path.exists()
        if default is not None and self.by_default:
            self.parameters = replace(default, robot_id=robot_id)

    @property
    def message(self) -> str:
        """Problems with the file and with announcements; empty if there are none."""
        if self.by_default:
            return self._announcement_problem
        return " ".join(problem for problem in (self._file_problem, self._announcement_problem) if problem)

    def poll(self) -> bool:
        """Check the file if it is time to; return whether the parameters in use changed.

        Cheap enough to call in every turn of a loop.
        """
        if self.path is None or time.monotonic() < self._poll_due:
            return False
        self._poll_due = time.monotonic() + POLL_PERIOD
        try:
            status = self.path.stat()
            signature = (status.st_mtime_ns, status.st_ino, status.st_size)
            if signature == self._seen:
                self._file_problem = self._content_problem
                return False
            text = read_text(self.path, ParameterFileError.bounds.size)
        except (OSError, UnicodeDecodeError) as error:
            # A missing file is no fault if the parameters were announced by another host.
            announced = self.parameters is not None and self._seen is None and isinstance(error, FileNotFoundError)
            self._file_problem = "" if announced else self._kept(_why_unread(self.path, error))
            return False
        # A file found at the start has its own age; one replaced later is the newest.
        now = now_utime()
        sequence = now if self._started else min(status.st_mtime_ns // 1000, now)
        self._seen = signature
        changed, self._content_problem = self._adopt(text, sha256_of(text), sequence, str(self.path))
        self._file_problem = self._content_problem
        return changed

    def handle(self, _utime: int, channel: str, message: Message) -> bool:
        """Handle an announcement (parameters_t); return whether the parameters in use changed."""
        if not isinstance(message, parameters_t) or channel != PARAMETERS.channel(self.robot_id):
            return False
        if time.monotonic() < self._rests_until:
            return False  # it will be repeated
        version = self._versions.of(message, now_utime())
        if version <= self.sequence and not self._announcement_problem:
            return False
        began = time.thread_time()
        changed = self._take(channel, message, version)
        cost = time.thread_time() - began
        if cost > COSTLY and (self._announcement_problem or len(message.yaml) > LONG):
            self._rests_until = time.monotonic() + min(REST * cost, LONGEST_REST)
        return changed

    def _take(self, channel: str, message: parameters_t, version: int) -> bool:
        if sha256_of(message.yaml) != message.sha256:
            self._announcement_problem = self._kept(f"{channel}: the announced sha256 does not fit the content")
            return False
        if version <= self.sequence:
            self._announcement_problem = ""
            return False
        changed, self._announcement_problem = self._adopt(message.yaml, message.sha256, version, channel)
        return changed

    def announcement(self) -> parameters_t | None:
        """Return the parameters_t message that announces the parameters in use; None without parameters."""
        return announcement(self.robot_id, self._text, self.sequence) if self._text else None

    def _adopt(self, text: str, sha256: str, sequence: int, source: str) -> tuple[bool, str]:
        """Use a file's text if it is valid; return whether the parameters changed, and any problem."""
        try:
            parameters = parse(text, source)
            if parameters.robot_id != self.robot_id:
                raise ParameterFileError(f"{source}: is of robot {parameters.robot_id}, not {self.robot_id}")
        except ParameterFileError as error:
            return False, self._kept(str(error))
        changed = sha256 != self.sha256
        self.parameters, self.sha256, self._text, self.by_default = parameters, sha256, text, False
        self.sequence = max(self.sequence, sequence)
        return changed, ""

    def _kept(self, problem: str) -> str:
        said = plain(problem, LONGEST_PROBLEM)
        return f"{said}. Parameters in use were kept." if self.parameters else f"{said}."


def _why_unread(path: Path, error: Exception) -> str:
    """Return why a parameter file cannot be read, and what to do if there is none."""
    if isinstance(error, FileNotFoundError):
        place = path.absolute()
        return f"There is no {place}; `cmr init --out {place.parent}` writes one"
    why = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
    return f"{path}: cannot be read: {why}"
