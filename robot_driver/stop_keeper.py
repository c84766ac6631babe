"""Brings the emergency stop to the disk, in a thread of its own: a slow disk holds up neither motors nor messages."""

import threading
from types import TracebackType

from robot_driver.stop_file import EngagedStop, StopFile

AGAIN_AFTER = 1.0  # s, when the disk refused
ENDING = 0.5  # s that the disk is given at the end
UNKNOWN = object()  # what the disk has after it failed: the old or the new


class StopKeeper:
    """Keeps the newest of what `keep` was given in `file`; a context manager, inside which it works.

    `loaded` is what was there at the beginning. What the disk refuses is tried again each second; `problem` says so.
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
        """Keep that this stop is engaged, or that none is; returns at once."""
        self._wanted = stop
        self._changed.set()

    @property
    def stored(self) -> bool:
        """Whether the disk has what was given last."""
        return self._stored is self._wanted

    @property
    def problem(self) -> str:
        """What is wrong with the disk, in a sentence; "" when all is well."""
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
            ending = self._end.is_set()  # before the last look at what is wanted
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
