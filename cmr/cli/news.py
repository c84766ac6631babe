"""What a process says of itself on the terminal: with the time of day, and not at all after --quiet."""

import sys
import time

from cmr.files import NO_ROOM
from cmr.plain_text import plain

_quiet = False


def be_quiet(wanted: bool = True) -> None:
    """Say no news and show no progress from now on; errors and results are still printed."""
    global _quiet
    _quiet = wanted


def is_quiet() -> bool:
    """Return whether --quiet was given."""
    return _quiet


def say(process: str, news: str) -> None:
    """Print what happened to a process on stderr: `cmr-driver: 14:03:12 ready`.

    What cannot be written, as stderr is a file on a full disk, is lost: that is no reason to end a driver.
    """
    if _quiet:
        return
    try:
        print(f"{process}: {time.strftime('%H:%M:%S')} {plain(news)}", file=sys.stderr, flush=True)
    except OSError as error:
        if error.errno not in NO_ROOM:
            raise
