"""The file in which an emergency stop outlives its sender, the driver and the computer.

The file exists exactly while the stop is engaged. Its content is informative only: whatever it is, and even if it
cannot be read, the robot is held until the stop is released. So neither a full disk, nor a damaged file, nor one of
another robot can cancel a stop.
"""

import json
import os
import re
import stat
import threading
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from urllib.parse import urlsplit

from cmr.bus.preflight import parse_udpm
from cmr.files import why_not_writable, write_atomically, write_out_folder

SYSTEM_FOLDER = Path("/var/lib/cmr")  # for a user without a home
LARGEST = 65_536  # bytes; larger files are not of this program
LITTER_AGE = 60.0  # s after which a temporary file counts as abandoned
LONGEST_TEXT = 200  # characters of a name or a reason
LATEST = 2**62  # us; limit for messages and calculations
AGAIN_AFTER = 1.0  # s, after a failure to write
ENDING = 0.5  # s allowed for the disk at the end
UNKNOWN = object()  # state of the disk after a failure: the old or the new one


@dataclass(frozen=True)
class EngagedStop:
    """An emergency stop that is engaged: its time [us since the Unix epoch], sender and reason.

    `doubt` is a sentence why it is only assumed to be engaged; empty for a known one.
    """

    since: int
    source: str
    reason: str
    doubt: str = ""


class StopFile:
    """The file of one robot on the bus at `url`, in a folder that it may share with others."""

    def __init__(self, folder: Path, robot_id: int, url: str) -> None:
        self._robot_id = robot_id
        self._bus = bus_address(url)
        self.path = folder / "estop" / f"robot_{robot_id}_{re.sub('[^A-Za-z0-9.]+', '_', self._bus)}.json"

    def load(self) -> EngagedStop | None:
        """Return the stop that is engaged; None if none is."""
        try:
            return self._stop_in(_content_of(self.path))
        except FileNotFoundError:
            return None
        except OSError as error:
            return self._assumed(f"cannot be read ({error.strerror or error})")
        except (ValueError, TypeError, KeyError, RecursionError):
            return self._assumed("is damaged")

    def store(self, stop: EngagedStop | None) -> None:
        """Store that a stop is engaged, or that none is: atomically, whatever happens meanwhile.

        Raises OSError if that fails.
        """
        if stop is not None:
            write_atomically(self._text_of(stop), self.path)
            return
        self.path.unlink(missing_ok=True)
        write_out_folder(self.path.parent)

    def prepare(self) -> str:
        """Make the folder, and remove incomplete files in it; return why stops cannot be stored, or ""."""
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            for litter in self.path.parent.glob(f".{self.path.name}.*"):
                with suppress(OSError):
                    if time.time() - litter.stat().st_mtime > LITTER_AGE:
                        litter.unlink()
        except OSError as error:
            return error.strerror or str(error)
        return why_not_writable(self.path.parent)

    def _text_of(self, stop: EngagedStop) -> str:
        about = {"schema": 1, "robot_id": self._robot_id, "bus": self._bus, "engaged": True}
        return json.dumps({**about, "since": stop.since, "source": stop.source, "reason": stop.reason}, indent=1) + "\n"

    def _stop_in(self, content: bytes) -> EngagedStop:
        """Return the stop in a file's content.

        Raises ValueError, TypeError, KeyError or RecursionError if the content is invalid.
        """
        entries = json.loads(content.decode("utf-8"))
        if entries["schema"] != 1 or entries["engaged"] is not True:
            raise ValueError("of another kind")
        if (entries["robot_id"], entries["bus"]) != (self._robot_id, self._bus):
            return self._assumed(f"is of robot {entries['robot_id']!r:.20} on the bus {entries['bus']!r:.60}")
        since, source, reason = entries["since"], entries["source"], entries["reason"]
        if not (type(since) is int and 0 <= since <= LATEST and isinstance(source, str) and isinstance(reason, str)):
            raise ValueError("of other types")
        return EngagedStop(since, plain(source), plain(reason))

    def _assumed(self, why: str) -> EngagedStop:
        """Return the stop to assume when only the file's existence is known."""
        since = time.time()
        with suppress(OSError):
            since = self.path.stat().st_mtime
        doubt = f"{self.path} {why}. It is taken for an emergency stop that is engaged."
        return EngagedStop(max(round(since * 1e6), 0), "cmr-driver", f"its file {plain(why)}", doubt)


class StopKeeper:
    """Stores the newest value given to `keep` in `file`; a context manager, inside which it works.

    It has its own thread: a slow disk delays neither motors nor messages. `loaded` is the stop found at the start. A
    failed write is repeated each second; `problem` reports it.
    """

    def __init__(self, file: StopFile) -> None:
        self._file = file
        self.loaded = file.load()
        self._wanted: EngagedStop | None = self.loaded
        self._stored: EngagedStop | object | None = self.loaded
        self._refused = file.prepare()
        self._changed, self._end = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._run, name="emergency stop", daemon=True)

    def __enter__(self) -> "StopKeeper":
        self._thread.start()
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        self._end.set()
        self._changed.set()
        self._thread.join(ENDING)

    def keep(self, stop: EngagedStop | None) -> None:
        """Store that this stop is engaged, or that none is; returns at once."""
        self._wanted = stop
        self._changed.set()

    @property
    def stored(self) -> bool:
        """Whether the disk has the newest value."""
        return self._stored is self._wanted

    @property
    def problem(self) -> str:
        """The problem with the disk, in a sentence; "" if there is none."""
        if not self._refused:
            return ""
        consequence = "An emergency stop would be forgotten at a restart"
        if not self.stored:
            engaged = self._wanted is not None
            consequence = f"A restart {'forgets that the emergency stop is' if engaged else 'finds the emergency stop'}"
            consequence += " engaged"
        return f"{consequence}: {self._file.path} cannot be written ({self._refused}). --state DIR chooses a folder."

    def _run(self) -> None:
        ending = False
        while not ending:
            self._changed.wait(None if self.stored else AGAIN_AFTER)
            self._changed.clear()
            ending = self._end.is_set()  # before the last check of the wanted value
            self._store(self._wanted)

    def _store(self, stop: EngagedStop | None) -> None:
        if stop is self._stored:
            return
        try:
            self._file.store(stop)
        except OSError as error:
            self._stored, self._refused = UNKNOWN, error.strerror or str(error)
        else:
            self._stored, self._refused = stop, ""


def state_folder() -> Path:
    """Return the folder for this user's persistent files: /var/lib for a service of systemd, else in the home
    folder.
    """
    if of_service := os.environ.get("STATE_DIRECTORY", "").split(":")[0]:
        return Path(of_service)
    base = Path(os.environ.get("XDG_STATE_HOME", ""))
    if base.is_absolute():
        return base / "cmr"
    try:
        return Path.home() / ".local" / "state" / "cmr"
    except RuntimeError:
        return SYSTEM_FOLDER


def bus_address(url: str) -> str:
    """Return the address in an LCM URL without its options: ttl and buffers do not make another bus."""
    parts = urlsplit(url)
    if parts.scheme == "udpm":
        multicast = parse_udpm(url)
        return f"udpm://{multicast.group}:{multicast.port}"
    return f"{parts.scheme}://{parts.netloc}"


def plain(text: str) -> str:
    """Return foreign text in a form safe for terminals: bounded, and without control characters."""
    return "".join(letter if letter.isprintable() else "?" for letter in text[:LONGEST_TEXT])


def _content_of(path: Path) -> bytes:
    """Return the content of a regular file. Raises OSError or ValueError."""
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK)  # a pipe in its place must not block
    with os.fdopen(descriptor, "rb") as stream:
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
            raise ValueError("no file")
        content = stream.read(LARGEST + 1)
    if len(content) > LARGEST:
        raise ValueError("too large")
    return content
