"""Keep a process on the newest parameters of a robot, whoever replaced them: a calibrator, a hand, another host."""

import time
from pathlib import Path
from typing import Any

from cmr.bus.messages import now_utime
from cmr.bus.streams import PARAMETERS
from cmr.parameters.file import ParameterFile, ParameterFileError, announcement, parse, sha256_of

POLL_PERIOD = 0.2  # s; a replaced file is in use within a second, with room to spare


class ParameterFollower:
    """The parameters of one robot in use by a process.

    They come from the file at `path` (None: none) and from announcements on PARAMETERS_N; the newest wins.
    `sequence` is the version in use: the time (us) at which it was written. What cannot be used changes nothing:
    `message` then says why, and is empty otherwise.
    """

    def __init__(self, robot_id: int, path: Path | None = None) -> None:
        self.robot_id = robot_id
        self.path = path
        self.parameters: ParameterFile | None = None
        self.sha256 = ""
        self.sequence = 0
        self.message = ""
        self._seen: tuple[int, int, int] | None = None
        self._text = ""
        self._poll_due = 0.0
        self._started = False
        self.poll()
        self._started = True

    def poll(self) -> bool:
        """Look at the file if it is time to; tell whether the parameters in use changed.

        Cheap enough for every turn of a loop.
        """
        if self.path is None or time.monotonic() < self._poll_due:
            return False
        self._poll_due = time.monotonic() + POLL_PERIOD
        try:
            status = self.path.stat()
            signature = (status.st_mtime_ns, status.st_ino, status.st_size)
            if signature == self._seen:
                return False
            text = self.path.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            self.message = f"{self.path}: cannot be read: {error}"
            self._seen = None
            return False
        # A file found at the start is as old as it says; one replaced later is the newest there is.
        sequence = now_utime() if self._started else status.st_mtime_ns // 1000
        self._seen = signature
        return self._adopt(text, sha256_of(text), sequence, str(self.path))

    def handle(self, _utime: int, channel: str, message: Any) -> bool:
        """Take an announcement (parameters_t); tell whether the parameters in use changed."""
        if channel != PARAMETERS.channel(self.robot_id) or message.sequence <= self.sequence:
            return False
        if sha256_of(message.yaml) != message.sha256:
            self.message = f"{channel}: the announced sha256 does not fit the content; parameters kept."
            return False
        return self._adopt(message.yaml, message.sha256, message.sequence, channel)

    def announcement(self) -> Any | None:
        """Return the parameters_t message that announces the parameters in use; None without parameters."""
        return announcement(self.robot_id, self._text, self.sequence) if self.parameters else None

    def _adopt(self, text: str, sha256: str, sequence: int, source: str) -> bool:
        try:
            parameters = parse(text, source)
            if parameters.robot_id != self.robot_id:
                raise ParameterFileError(f"{source}: is of robot {parameters.robot_id}, not {self.robot_id}")
        except ParameterFileError as error:
            self.message = f"{error}. Parameters in use were kept."
            return False
        changed = sha256 != self.sha256
        self.parameters, self.sha256, self.message = parameters, sha256, ""
        self._text = text
        self.sequence = max(self.sequence, sequence)
        return changed
