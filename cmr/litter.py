"""Temporary files and folders whose names show their process, so that those of killed processes are removed.

A process that is killed cannot tidy up after itself. So the names of temporary files contain their process, and the
next process that makes one in the same folder removes those of processes that have ended.
"""

import hashlib
import os
import re
import secrets
import shutil
import socket
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

# .robot_0.yaml.1a2b3c-4711-0f3c2a1b.tmp: final name, host, process id, and a random number.
NAME = re.compile(r"\..+\.([0-9a-f]{6})-([0-9]+)-[0-9a-f]{8}\.tmp")
SLACK = 2.0  # s by which clocks of files and processes differ

_swept: set[Path] = set()  # folders that this process has cleaned


def temporary_beside(path: Path) -> Path:
    """Return a name for a temporary file or folder beside `path`; nothing is created.

    The first call for a folder also removes what ended processes have left there.
    """
    folder = path.parent.absolute()
    if folder not in _swept:
        _swept.add(folder)
        sweep(folder)
    return path.with_name(f".{path.name}.{_host()}-{os.getpid()}-{secrets.token_hex(4)}.tmp")


@contextmanager
def temporary_folder(name: str) -> Iterator[Path]:
    """Make a temporary folder; delete it with its contents on exit."""
    folder = temporary_beside(Path(tempfile.gettempdir()) / name)
    folder.mkdir(mode=0o700)
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def sweep(folder: Path) -> None:
    """Remove from a folder the temporary files of ended processes of this computer."""
    with suppress(OSError):  # it does not exist, or we may not read it
        for path in folder.iterdir():
            match = NAME.fullmatch(path.name)
            if match and match[1] == _host() and _is_gone(int(match[2]), path):
                _remove(path)


def _remove(path: Path) -> None:
    with suppress(OSError):  # another process removed it first, or it belongs to another user
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink()


def _is_gone(process: int, path: Path) -> bool:
    """Return whether the process that made a file has ended; its id may have been reused since."""
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return True
    except (PermissionError, OverflowError):
        pass
    with suppress(OSError, ValueError, IndexError):
        return _started(process) > path.lstat().st_mtime + SLACK
    return False


def _started(process: int) -> float:
    """Return when a process started [s since the epoch]. Raises OSError elsewhere than on Linux."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()  # after the process name
    booted = next(line for line in Path("/proc/stat").read_text().splitlines() if line.startswith("btime"))
    return int(booted.split()[1]) + int(fields[19]) / os.sysconf("SC_CLK_TCK")


@cache
def _host() -> str:
    """Return an identifier of this computer, for folders shared between computers."""
    return hashlib.sha256(socket.gethostname().encode()).hexdigest()[:6]
