"""Start other processes and see to it that every one of them ends, whatever happens."""

import ctypes
import signal
import subprocess
import sys
from pathlib import Path
from types import TracebackType

PATIENCE = 3.0  # s for a process to end after SIGTERM; ours take less than 1 s
PR_SET_PDEATHSIG = 1  # Linux, prctl(2): the signal a process gets when its parent dies


class Children:
    """Processes of ours; a context manager that stops them in reverse order of their start.

    Each writes what it says to `<folder>/<name>.txt`.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._running: dict[str, subprocess.Popen[bytes]] = {}

    def __enter__(self) -> "Children":
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        for name in reversed(list(self._running)):
            self.stop(name)

    def start(self, name: str, command: list[str]) -> None:
        """Start a process in a session of its own, so that Ctrl-C reaches only its parent, who stops it in order."""
        with (self.folder / f"{name}.txt").open("wb") as said:
            self._running[name] = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=said,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                preexec_fn=_die_with_parent,
            )

    def stop(self, name: str) -> None:
        """End a process: SIGTERM, and SIGKILL for one that does not listen."""
        process = self._running.pop(name)
        if process.poll() is None:
            process.terminate()
            try:
                process.wait(PATIENCE)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()

    def failed(self) -> str:
        """Return a sentence about a process that ended by itself with an error; empty if there is none."""
        for name, process in self._running.items():
            if process.poll() not in (None, 0):
                said = self.said(name).strip().splitlines()
                return f"{name} ended with exit code {process.returncode}: {said[-1] if said else 'without a word'}"
        return ""

    def said(self, name: str) -> str:
        """Return what a process has written so far."""
        return (self.folder / f"{name}.txt").read_text(errors="replace")


def our_command(name: str) -> str:
    """Return the path of one of our commands, installed beside the Python that runs this one."""
    return str(Path(sys.executable).parent / name)


def _die_with_parent() -> None:
    """Have the kernel end this process when its parent is killed; elsewhere than on Linux, do without."""
    try:
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
    except (OSError, AttributeError):
        return
