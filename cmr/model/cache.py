"""Where compiled code is kept for later processes. Imports no Numba, which takes half a second."""

import os
import tempfile
from functools import cache
from pathlib import Path


@cache
def lasting_folder() -> Path | None:
    """Return the user's cache folder; None where it cannot be written."""
    folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "cmr"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return None
    return folder if os.access(folder, os.W_OK) else None


@cache
def cache_folder() -> Path:
    """Return the user's cache folder for compiled code, or a temporary one where that cannot be written."""
    return lasting_folder() or Path(tempfile.mkdtemp(prefix="cmr-"))
