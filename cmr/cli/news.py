"""News of a process on the terminal, with the time of day; disabled by --quiet."""

import sys
import time

from cmr.files import NO_ROOM
from cmr.plain_text import plain

_quiet = False


def be_quiet(wanted: bool = True) -> None:
    """Disable news and progress; errors and results are still printed."""
    global _quiet
    _quiet = wanted


def is_quiet() -> bool:
    """Return whether --quiet was given."""
    return _quiet


def say(process: str, news: str) -> None:
    """Print what happened to a process on stderr: `cmr-driver: 14:03:12 ready`.

    Output that cannot be written, because stderr is a file on a full disk, is lost; this must not end a driver.
    """
    if _quiet:
        return
    try:
        print(f"{process}: {time.strftime('%H:%M:%S')} {plain(news)}", file=sys.stderr, flush=True)
    except OSError as error:
        if error.errno not in NO_ROOM:
            raise
