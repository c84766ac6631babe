"""End at once on a signal: what is done is kept, and the same command goes on from there."""

import os
import signal

from cmr.cli.progress import leave_terminal

EXIT_INTERRUPTED = 130


def end_on_signals(command: str) -> None:
    """End on SIGINT, SIGTERM and SIGHUP with a sentence; processes of ours end with their parent."""

    def end(_number: int, _frame: object) -> None:
        leave_terminal()
        os.write(2, f"\n{command}: stopped; the same command goes on from here.\n".encode())
        os._exit(EXIT_INTERRUPTED)

    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, end)
