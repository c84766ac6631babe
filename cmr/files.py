"""Files that are never half there, and folders that are not left empty."""

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
NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)  # what keeps a file from growing
NO_FILE = "it is no regular file, such as can be read to its end"


def open_regular(path: Path) -> BinaryIO:
    """Open a file that is one: a pipe would be waited for, and a device such as /dev/zero has no end.

    Raises OSError when it cannot be opened, or is none.
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
        while len(data) <= largest and (piece := stream.read(PIECE_BYTES)):  # as much at once would be set aside
            data += piece
    if len(data) > largest:
        raise OSError(errno.EFBIG, f"it is larger than {largest / 1e6:g} MB, which is the most that is read", str(path))
    return data.decode("utf-8").replace("\r\n", "\n").replace("\r", "\n")


@contextmanager
def folder_for_results(folder: Path) -> Iterator[None]:
    """Make a folder, and take it away again if nothing was written into it; so are those that were made for it.

    Raises OSError when it cannot be made.
    """
    made = [one for one in (folder, *folder.parents) if not one.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        yield
    finally:
        for one in made:
            with suppress(OSError):  # it is not empty, or was not made
                one.rmdir()


@contextmanager
def gone_before_and_after(folder: Path) -> Iterator[None]:
    """Begin without this folder, and leave none, whatever is in it."""
    shutil.rmtree(folder, ignore_errors=True)
    try:
        yield
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def why_not_writable(folder: Path) -> str:
    """Return why nothing can be written into a folder, which may have to be made first; empty if it can."""
    nearest = next(one for one in (folder, *folder.absolute().parents) if one.exists())
    if not nearest.is_dir():
        return f"{'it' if nearest == folder else nearest} is a file, not a folder"
    return "" if os.access(nearest, os.W_OK | os.X_OK) else os.strerror(errno.EACCES)


def write_atomically(content: str | bytes, path: Path, mode: int = 0o644) -> None:
    """Write a text, or bytes, so that a reader, or a crash at any moment, finds the old file or the new one.

    `mode` says who may read it: by default everybody, because processes of other people do.
    Raises OSError when the folder cannot be written.
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
    """Have the disk keep which files a folder has: without it, a new name may be gone after a loss of power.

    Raises OSError when the disk fails.
    """
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):  # some file systems know no such thing
            raise
    finally:
        os.close(descriptor)
