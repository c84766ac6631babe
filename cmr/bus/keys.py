"""The key of the bus: a private file shared by all computers of a laboratory."""

import os
import stat
from hashlib import blake2b
from pathlib import Path

from cmr.bus.signing import KEY_BYTES
from cmr.cli import configuration
from cmr.cli.errors import ExpectedError
from cmr.files import read_text, write_atomically

LARGEST_FILE = 1000  # bytes
SHOWN = 8  # hexadecimal digits of a key's fingerprint, for comparison by eye
FOR_OTHERS = stat.S_IRWXG | stat.S_IRWXO


class KeyFileError(ExpectedError):
    """The key cannot be used; the text says which file, why, and what to do."""


def key_in_use() -> bytes | None:
    """Return this computer's bus key, None if it has none. Raises KeyFileError when the key cannot be used."""
    path, is_named = configuration.key_file()
    if not is_named and not os.path.lexists(path):
        return None
    return read_key(path)


def read_key(path: Path) -> bytes:
    """Read the key from a file. Raises KeyFileError when it holds no key, or when other users may read it."""
    try:
        if path.stat().st_mode & FOR_OTHERS:
            raise KeyFileError(
                f"{path}: other users may read this key. If nobody has: chmod 600 {path}; otherwise make a new one."
            )
        key = bytes.fromhex(read_text(path, LARGEST_FILE).strip())
    except OSError as error:
        raise KeyFileError(f"{path}: the key cannot be read: {error.strerror}.") from error
    except ValueError as error:
        raise _no_key(path) from error
    if len(key) != KEY_BYTES:
        raise _no_key(path)
    return key


def write_new_key(path: Path, replace: bool = False) -> bytes:
    """Make a key and write it to a file that this user alone can read; return it.

    Raises KeyFileError when the file exists and `replace` is false, or when it cannot be written.
    """
    if os.path.lexists(path) and not replace:
        raise KeyFileError(f"{path}: there is already a key; --replace replaces it with a new one.")
    key = os.urandom(KEY_BYTES)
    try:
        write_atomically(f"{key.hex()}\n", path, stat.S_IRUSR | stat.S_IWUSR)
    except OSError as error:
        raise KeyFileError(f"{path}: the key cannot be written: {error.strerror}.") from error
    return key


def shown(key: bytes) -> str:
    """Return a short fingerprint of a key, for comparison by eye; the key cannot be recovered from it."""
    return blake2b(key, digest_size=SHOWN // 2, person=b"CMR key shown").hexdigest()


def _no_key(path: Path) -> KeyFileError:
    return KeyFileError(
        f"{path}: holds no key: it should be one line of {2 * KEY_BYTES} hexadecimal digits. See: cmr key"
    )
