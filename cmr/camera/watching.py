"""Process a camera's pictures in a separate thread, so that the process handles messages meanwhile."""

import threading
import time
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

from cmr.camera.place import Place
from cmr.camera.robots import Pose
from cmr.camera.sources import Camera, Film, SourceError, Taken
from cmr.camera.watcher import Watcher

MOST_WAITING = 100  # results not yet taken; above, the oldest is dropped
LIVE = 60.0  # s; older pictures are from a recording and have no latency
AGAIN = 2.0  # s between attempts to reopen a lost camera


class Seen(NamedTuple):
    """What a picture showed: poses by robot id, and the camera's pose, None if it is unknown."""

    taken: Taken
    poses: dict[int, Pose]
    place: Place | None


class Watching:
    """A thread that reads a source's pictures and finds the robots in them; `results` returns what was seen.

    `problem` says why no robots are seen; `done` is set when the source has ended, `failed` when it broke off. `reopen`
    opens a camera again after it was lost.
    """

    def __init__(self, source: Camera | Film, reopen: Callable[[], Camera | Film], watcher: Watcher) -> None:
        self.problem = ""
        self.failed = False
        self.pictures = 0
        self._source, self._reopen, self._watcher = source, reopen, watcher
        self._results: deque[Seen] = deque(maxlen=MOST_WAITING)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="camera", daemon=True)
        self._thread.start()

    @property
    def done(self) -> bool:
        """Whether the source has ended and all results have been returned."""
        return not self._thread.is_alive() and not self._results

    def results(self) -> list[Seen]:
        """Return what was seen since the last call, oldest first."""
        results = []
        while self._results:
            results.append(self._results.popleft())
        return results

    def close(self) -> None:
        """Stop, and release the camera unless it is blocked."""
        self._stop.set()
        self._thread.join(0.5)

    def _run(self) -> None:
        while not self._stop.is_set():
            try:
                taken = self._source.read()
            except SourceError as error:
                self.problem = str(error)
                if self._source.ends:
                    self.failed = True
                    break
                self._open_again()
                continue
            if taken is None:
                break
            poses = self._watcher.watch(taken.picture)
            self.problem = self._watcher.problem
            self.pictures += 1
            self._results.append(Seen(taken, poses, self._watcher.place))
        self._source.close()

    def _open_again(self) -> None:
        self._source.close()
        while not self._stop.wait(AGAIN):
            try:
                self._source = self._reopen()
            except SourceError as error:
                self.problem = str(error)
            else:
                return


class Latency:
    """Age of poses when they are published: the median and the largest [s] since the last summary."""

    def __init__(self) -> None:
        self._ages: list[float] = []

    def take(self, utime: int) -> None:
        """Record that a picture exposed at `utime` [us] is published now."""
        age = time.time() - utime / 1e6
        if age < LIVE:
            self._ages.append(age)

    def summary(self) -> str:
        """Return the latency in words and reset it; empty if nothing was published."""
        ages, self._ages = sorted(self._ages), []
        if not ages:
            return ""
        return f"Poses are {1e3 * ages[len(ages) // 2]:.0f} ms old when sent, {1e3 * ages[-1]:.0f} ms at most."
