"""Start other processes and make sure that every one of them ends, whatever happens."""

import ctypes
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import TracebackType

PATIENCE = 3.0  # s for a process to end after SIGTERM; ours take less than 1 s
LAST_BYTES = 1 << 14  # in which the last line of a process's output is searched
PR_SET_PDEATHSIG = 1  # Linux, prctl(2): the signal a process gets when its parent dies


class Children:
    """Child processes; a context manager that stops them in reverse order of their start.

    Each writes its output to `<folder>/<name>.txt`.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._running: dict[str, subprocess.Popen[bytes]] = {}
        self._started: set[str] = set()

    def __enter__(self) -> "Children":
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        for name in reversed(list(self._running)):
            self.stop(name)

    def start(self, name: str, command: list[str]) -> int:
        """Start a process in a session of its own, so that Ctrl-C reaches only its parent, which stops it in order.

        The output of a restarted process is appended. Returns the process id.
        """
        with self._file(name).open("ab" if name in self._started else "wb") as said:
            self._started.add(name)
            self._running[name] = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=said,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                preexec_fn=_die_with_parent,
            )
        return self._running[name].pid

    def stop(self, *names: str) -> dict[str, int]:
        """End processes at the same time: SIGTERM, then SIGKILL for those that do not react; return exit codes."""
        processes = {name: process for name in names if (process := self._running.pop(name, None)) is not None}
        for process in processes.values():
            if process.poll() is None:
                process.terminate()
        deadline = time.monotonic() + PATIENCE
        for process in processes.values():
            try:
                process.wait(max(deadline - time.monotonic(), 0.0))
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        return {name: process.returncode for name, process in processes.items()}

    def is_running(self, name: str) -> bool:
        """Return whether a process runs."""
        process = self._running.get(name)
        return process is not None and process.poll() is None

    def ended(self) -> dict[str, int]:
        """Return the processes that ended by themselves since the last call, with their exit codes."""
        codes = {name: code for name, process in self._running.items() if (code := process.poll()) is not None}
        for name in codes:
            del self._running[name]
        return codes

    def failed(self) -> str:
        """Return a sentence about a process that ended by itself with an error; empty if there is none."""
        for name, process in self._running.items():
            if process.poll() not in (None, 0):
                said = self.last_words(name) or "without a word"
                return f"{name} ended with exit code {process.returncode}: {said}"
        return ""

    def said(self, name: str) -> str:
        """Return the output of a process so far."""
        return self._file(name).read_text(errors="replace")

    def last_words(self, name: str) -> str:
        """Return the last line of a process's output; empty without output."""
        if name not in self._started:
            return ""
        with self._file(name).open("rb") as stream:
            stream.seek(max(stream.seek(0, os.SEEK_END) - LAST_BYTES, 0))
            said = stream.read().decode(errors="replace").strip().splitlines()
        return said[-1] if said else ""

    def _file(self, name: str) -> Path:
        return self.folder / f"{name.replace(' ', '_')}.txt"


def our_command(name: str) -> str:
    """Return the path of one of our commands, installed beside the Python that runs this one."""
    return str(Path(sys.executable).parent / name)


def _die_with_parent() -> None:
    """Ask the kernel to end this process when its parent is killed; only possible on Linux."""
    try:
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
    except (OSError, AttributeError):
        return
