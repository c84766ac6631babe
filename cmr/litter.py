"""Temporary files and folders, named so that those of processes that were killed are known and removed.

A process that is killed cannot tidy up after itself. So its temporary files say in their names who made them, and the
next process that makes one in the same folder removes those whose maker is gone.
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

# .robot_0.yaml.1a2b3c-4711-0f3c2a1b.tmp: what it becomes, the host and the id of the process, and a random number.
NAME = re.compile(r"\..+\.([0-9a-f]{6})-([0-9]+)-[0-9a-f]{8}\.tmp")
SLACK = 2.0  # s by which clocks of files and processes differ

_swept: set[Path] = set()  # folders that this process has looked through


def temporary_beside(path: Path) -> Path:
    """Return the name of a temporary file or folder that becomes `path`, or has to do with it; it is not made yet.

    Removes those in the same folder that processes have left that are gone; once, which is enough.
    """
    folder = path.parent.absolute()
    if folder not in _swept:
        _swept.add(folder)
        sweep(folder)
    return path.with_name(f".{path.name}.{_host()}-{os.getpid()}-{secrets.token_hex(4)}.tmp")


@contextmanager
def temporary_folder(name: str) -> Iterator[Path]:
    """Make a folder among the temporary files, and remove it with all that is in it."""
    folder = temporary_beside(Path(tempfile.gettempdir()) / name)
    folder.mkdir(mode=0o700)
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def sweep(folder: Path) -> None:
    """Remove from a folder what processes of this computer have left there that are gone."""
    with suppress(OSError):  # it is not there, or others may not look into it
        for path in folder.iterdir():
            match = NAME.fullmatch(path.name)
            if match and match[1] == _host() and _is_gone(int(match[2]), path):
                _remove(path)


def _remove(path: Path) -> None:
    with suppress(OSError):  # another process was faster, or it is somebody else's
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink()


def _is_gone(process: int, path: Path) -> bool:
    """Return whether the process that made a file has ended; its number may be that of another process by now."""
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
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()  # what is before is its name
    booted = next(line for line in Path("/proc/stat").read_text().splitlines() if line.startswith("btime"))
    return int(booted.split()[1]) + int(fields[19]) / os.sysconf("SC_CLK_TCK")


@cache
def _host() -> str:
    """Return what tells this computer from others with which it shares a folder."""
    return hashlib.sha256(socket.gethostname().encode()).hexdigest()[:6]
