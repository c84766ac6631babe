"""Start and end of a command: its executable calls `run`.

The command's module is imported only after Ctrl-C has been set up to end the process quietly, even during imports; this
module itself imports almost nothing.
"""

import os
import signal
import sys
from importlib import import_module


def run(module: str) -> int:
    """Run `main()` of a command's module and exit: 0 done, 1 failed, 2 wrong usage, 130 interrupted."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, _end)
    from cmr.distribution import how_to_install_again, outdated_messages

    if outdated_messages():
        again = how_to_install_again()
        return _refuse(f"the messages in lcmtypes/ have changed since CMR was installed. Install it again: {again}")
    try:
        main = import_module(module).main
        from cmr.cli.command_line import guarded

        code = guarded(main, sys.argv[1:])
    except ImportError as error:  # some import LCM only when they need it
        if "libglib-2.0.so.0" not in str(error):
            raise
        return _refuse(
            "LCM needs the system's library libglib-2.0.so.0. To install it: sudo apt-get install libglib2.0-0"
        )
    sys.stdout.flush()
    sys.stderr.flush()
    # Everything of ours is closed; cleaning up Numba would delay an interrupted process by half a second.
    os._exit(code)


def _refuse(reason: str) -> int:
    print(f"{sys.argv[0].rsplit('/', 1)[-1]}: {reason}", file=sys.stderr)
    return 1


def _end(_number: int, _frame: object) -> None:
    progress = sys.modules.get("cmr.cli.progress")  # no imports here: an import may be what is interrupted
    if progress is not None and hasattr(progress, "leave_terminal"):
        progress.leave_terminal()
    os._exit(130)
