"""The cmr-* commands: each is a thin process around classes that know no bus.

This module is what the shell starts. It loads a command only after it has seen to it that Ctrl-C ends the
process quietly even while libraries are still being imported.
"""

import os
import signal
import sys
from importlib import import_module

from cmr.threads import one_thread_for_linear_algebra

one_thread_for_linear_algebra()


def run(module: str) -> int:
    """Run `main()` of a command's module and exit: 0 done, 1 failed, 2 wrong usage, 130 interrupted."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, _end)
    try:
        main = import_module(module).main
        from cmr.commands.command_line import guarded
    except ImportError as error:
        if "libglib-2.0.so.0" not in str(error):
            raise
        command = sys.argv[0].rsplit("/", 1)[-1]
        print(
            f"{command}: LCM needs the system's library libglib-2.0.so.0. To install it: "
            "sudo apt-get install libglib2.0-0",
            file=sys.stderr,
        )
        return 1
    code = guarded(main, sys.argv[1:])
    sys.stdout.flush()
    sys.stderr.flush()
    # Everything of ours is closed; to take Numba apart would keep an interrupted process for half a second longer.
    os._exit(code)


def _end(_number: int, _frame: object) -> None:
    progress = sys.modules.get("cmr.progress")  # nothing is imported here: an import may be what is interrupted
    if progress is not None and hasattr(progress, "leave_terminal"):
        progress.leave_terminal()
    os._exit(130)


def calibrate() -> int:
    """Start cmr-calibrate."""
    return run("cmr.commands.calibrate")


def camera() -> int:
    """Start cmr-camera."""
    return run("cmr.commands.camera")


def demo() -> int:
    """Start cmr-demo."""
    return run("cmr.commands.demo")


def diagnose() -> int:
    """Start cmr-diagnose."""
    return run("cmr.commands.diagnose")


def driver() -> int:
    """Start cmr-driver."""
    return run("robot_driver.main")


def emulate() -> int:
    """Start cmr-emulate."""
    return run("robot_driver.emulator.main")


def fidelity() -> int:
    """Start cmr-fidelity."""
    return run("cmr.commands.fidelity")


def import_log() -> int:
    """Start cmr-import."""
    return run("cmr.tools.import_log")


def log() -> int:
    """Start cmr-log."""
    return run("cmr.tools.log_main")


def pilot() -> int:
    """Start cmr-pilot."""
    return run("cmr.commands.pilot")


def plot() -> int:
    """Start cmr-plot."""
    return run("cmr.tools.plot")


def replay() -> int:
    """Start cmr-replay."""
    return run("cmr.tools.replay")


def run_scenario() -> int:
    """Start cmr-run."""
    return run("cmr.commands.run")


def sim() -> int:
    """Start cmr-sim."""
    return run("cmr.commands.sim")


def spy() -> int:
    """Start cmr-spy."""
    return run("cmr.tools.spy")


def sweep() -> int:
    """Start cmr-sweep."""
    return run("cmr.commands.sweep")


def umbrella() -> int:
    """Start cmr, which starts any of the others."""
    return run("cmr.commands.umbrella")


def view() -> int:
    """Start cmr-view."""
    return run("cmr.commands.view")
