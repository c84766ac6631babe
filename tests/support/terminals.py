"""What a program shows on a pseudo-terminal."""

import os
import re
import select

PATIENCE = 60.0  # s until something that must happen is given up


def read_all(terminal: int) -> str:
    """Return all that is written to a terminal until its last writer is gone."""
    shown = b""
    while select.select([terminal], [], [], PATIENCE)[0]:
        try:
            shown += os.read(terminal, 4096)
        except OSError:  # that is how Linux says so
            break
    os.close(terminal)
    return shown.decode()


def plain(shown: str) -> str:
    """Return what was shown without the terminal's control sequences."""
    return re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", shown)
