"""Write files atomically, read them within limits, and leave no empty folders behind."""

import errno
import os
import shutil
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from cmr.litter import temporary_beside

PIECE_BYTES = 1 << 16
NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)  # errors that mean there is no space left
NO_FILE = "it is no regular file, such as can be read to its end"


def open_regular(path: Path) -> BinaryIO:
    """Open a regular file; opening a pipe would block, and a device such as /dev/zero has no end.

    Raises OSError when it cannot be opened, or is not a regular file.
    """
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NOCTTY | os.O_NONBLOCK)
    try:
        mode = os.fstat(descriptor).st_mode
        if stat.S_ISDIR(mode):
            raise OSError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
        if not stat.S_ISREG(mode):
            raise OSError(errno.EINVAL, NO_FILE, str(path))
        return os.fdopen(descriptor, "rb")
    except BaseException:
        os.close(descriptor)
        raise


def read_text(path: Path, largest: int) -> str:
    """Return the text of a regular file of `largest` bytes at most.

    Raises OSError when it cannot be read or is larger, UnicodeDecodeError when it is not UTF-8.
    """
    data = bytearray()
    with open_regular(path) as stream:
        # Reading `largest` at once would allocate that much memory
        while len(data) <= largest and (piece := stream.read(PIECE_BYTES)):
            data += piece
    if len(data) > largest:
        raise OSError(errno.EFBIG, f"it is larger than {largest / 1e6:g} MB, which is the most that is read", str(path))
    return data.decode("utf-8").replace("\r\n", "\n").replace("\r", "\n")


@contextmanager
def folder_for_results(folder: Path) -> Iterator[None]:
    """Make a folder with its parents; on exit, remove those that were made here and stayed empty.

    Raises OSError when it cannot be made.
    """
    made = [one for one in (folder, *folder.parents) if not one.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        yield
    finally:
        for one in made:
            with suppress(OSError):  # it is not empty, or was never made
                one.rmdir()


@contextmanager
def gone_before_and_after(folder: Path) -> Iterator[None]:
    """Delete this folder and its contents on entry and on exit."""
    shutil.rmtree(folder, ignore_errors=True)
    try:
        yield
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def why_not_writable(folder: Path) -> str:
    """Return why a folder, which need not exist yet, is not writable; empty if it is."""
    nearest = next(one for one in (folder, *folder.absolute().parents) if one.exists())
    if not nearest.is_dir():
        return f"{'it' if nearest == folder else nearest} is a file, not a folder"
    return "" if os.access(nearest, os.W_OK | os.X_OK) else os.strerror(errno.EACCES)


def write_atomically(content: str | bytes, path: Path, mode: int = 0o644) -> None:
    """Write a file atomically: a reader, or a crash at any moment, finds either the old file or the new one.

    `mode` are its permissions; by default everybody may read it, because other users' processes do. Raises OSError when
    the folder cannot be written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = temporary_beside(path)
    try:
        descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600)
        with os.fdopen(descriptor, "wb") as stream:
            stream.write(content.encode("utf-8") if isinstance(content, str) else content)
            stream.flush()
            os.fsync(stream.fileno())
        temporary.chmod(mode)
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    write_out_folder(path.parent)


def write_out_folder(folder: Path) -> None:
    """Sync a folder to disk; otherwise a new file's name may be lost in a power failure.

    Raises OSError when the disk fails.
    """
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):  # some file systems do not support it
            raise
    finally:
        os.close(descriptor)
