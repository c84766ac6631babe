"""The cmr-* commands: each is a thin process around classes that are independent of the bus.

These functions are the entry points of the executables. `cmr.cli.start` loads a command only after Ctrl-C has been set
up to end the process quietly, even during imports.
"""

from cmr.cli.start import run
from cmr.threads import one_thread_for_linear_algebra

one_thread_for_linear_algebra()


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
    return run("cmr.commands.emulate")


def export() -> int:
    """Start cmr-export."""
    return run("cmr.exporting.command")


def fidelity() -> int:
    """Start cmr-fidelity."""
    return run("cmr.commands.fidelity")


def import_log() -> int:
    """Start cmr-import."""
    return run("cmr_tools.importing.import_log")


def investigate() -> int:
    """Start cmr-investigate."""
    return run("cmr.commands.investigating.command")


def laws() -> int:
    """Start cmr-laws."""
    return run("cmr.diagnosis.collection_command")


def log() -> int:
    """Start cmr-log."""
    return run("cmr_tools.logs.main")


def pilot() -> int:
    """Start cmr-pilot."""
    return run("cmr.commands.pilot")


def agent() -> int:
    """Start cmr-agent."""
    return run("cmr.commands.agent")


def plot() -> int:
    """Start cmr-plot."""
    return run("cmr_tools.plot.main")


def replay() -> int:
    """Start cmr-replay."""
    return run("cmr_tools.replay.main")


def ros2() -> int:
    """Start cmr-ros2."""
    return run("robot_driver.ros2.command")


def run_scenario() -> int:
    """Start cmr-run."""
    return run("cmr.commands.run")


def sim() -> int:
    """Start cmr-sim."""
    return run("cmr.commands.sim")


def spy() -> int:
    """Start cmr-spy."""
    return run("cmr_tools.spy.main")


def sweep() -> int:
    """Start cmr-sweep."""
    return run("cmr.commands.sweep")


def teleop() -> int:
    """Start cmr-teleop."""
    return run("cmr.commands.by_hand.teleop")


def tracker() -> int:
    """Start cmr-tracker."""
    return run("cmr.tracker.command")


def umbrella() -> int:
    """Start cmr, which starts any of the others."""
    return run("cmr.commands.umbrella")


def view() -> int:
    """Start cmr-view."""
    return run("cmr.commands.view")
