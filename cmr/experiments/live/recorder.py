"""Record all messages on the bus in an LCM event log; a separate process started by cmr-run.

Usage: python -m cmr.experiments.live.recorder FILE [--lcm-url URL]
"""

import argparse
import sys
import threading
from contextlib import suppress
from pathlib import Path

from cmr.bus.messages import now_utime
from cmr.bus.preflight import handled, open_lcm
from cmr.bus.process import Process
from cmr.experiments.live.jobs import LOG
from cmr.processes.job import CANNOT_WRITE
from cmr.recordings.log_file import LogFile

RATE = 10.0  # Hz, of checking its state
LONGEST_WAIT = 100  # ms for a message, before checking whether to end


class Recorder:
    """Writes every message to the file at `path` in a thread, so that each gets its time of arrival.

    Raises OSError when the file cannot be written.
    """

    def __init__(self, path: Path, url: str) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        self.events = 0
        self._log = LogFile(path)
        self._lcm = open_lcm(url)
        subscription = self._lcm.subscribe(".*", self._write)
        subscription.set_queue_capacity(0)  # unlimited
        self._is_closing = False
        self._error: Exception | None = None
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    @property
    def is_well(self) -> bool:
        """Whether it can write without problems."""
        return self._error is None

    def check(self) -> None:
        """Raise the error that prevents writing, if any."""
        if self._error is not None:
            raise self._error

    def close(self) -> None:
        """Write what has arrived, and close the file; `check` raises errors."""
        self._is_closing = True
        self._thread.join()
        try:
            while self._error is None and handled(self._lcm):
                pass
            self._log.close()
        except OSError as error:
            self._error = self._error or error

    def _listen(self) -> None:
        try:
            while not self._is_closing and self._error is None:
                handled(self._lcm, LONGEST_WAIT)
                self._log.flush_if_due()
        except Exception as error:  # any exception: reported by the thread that checks the state
            self._error = error

    def _write(self, channel: str, data: bytes) -> None:
        try:
            self._log.write(now_utime(), channel, data)
        except OSError as error:  # LCM's own errors are retried by `handled`
            self._error = self._error or error
        self.events += 1


def free_path(path: Path) -> Path:
    """Return the path, or a numbered one if the file exists: an earlier recorder died."""
    number = 1
    free = path
    while free.exists():
        number += 1
        free = path.with_name(f"{path.stem}_{number}{path.suffix}")
    return free


def logs_in(folder: Path) -> list[Path]:
    """Return the logs that recorders wrote into a folder."""
    return sorted(folder.glob(f"{Path(LOG).stem}*{Path(LOG).suffix}"))


def main(arguments: list[str]) -> int:
    """Record until a signal comes; return the exit code."""
    options = argparse.ArgumentParser(prog="cmr.experiments.live.recorder", description=__doc__)
    options.add_argument("file", type=Path)
    options.add_argument("--lcm-url")
    chosen = options.parse_args(arguments)
    path = free_path(chosen.file)
    try:
        with Process("cmr-run recorder", chosen.lcm_url) as process:
            _record(process, path)
            return process.exit_code
    except OSError as error:
        with suppress(OSError):  # stdout may be on the same disk
            print(f"{path}: nothing more can be recorded: {error.strerror or error}.", file=sys.stderr, flush=True)
        return CANNOT_WRITE


def _record(process: Process, path: Path) -> None:
    """Record until a signal comes. Raises OSError when the file cannot be written."""
    recorder = Recorder(path, process.bus.url)
    try:
        for _ in process.loop(RATE):
            recorder.check()
            process.message = f"{recorder.events} messages in {path}."
    finally:
        recorder.close()
    recorder.check()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
