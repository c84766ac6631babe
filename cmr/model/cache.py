"""The cache folder for compiled code. Does not import Numba, which takes half a second."""

import atexit
import os
import shutil
import tempfile
from functools import cache
from pathlib import Path

from cmr.litter import temporary_beside


@cache
def lasting_folder() -> Path | None:
    """Return the user's cache folder; None if it is not writable."""
    folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "cmr"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return None
    return folder if os.access(folder, os.W_OK) else None


@cache
def cache_folder() -> Path:
    """Return the user's cache folder for compiled code, or a temporary one if that is not writable."""
    return lasting_folder() or _temporary_folder()


def _temporary_folder() -> Path:
    """Make a folder that is removed with this process; one of a killed process is removed by the next."""
    folder = temporary_beside(Path(tempfile.gettempdir()) / "cmr-cache")
    folder.mkdir(mode=0o700)
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder
