"""What demonstrations have in common: the processes of a scenario are started, and a page of their world is opened."""

import re
import subprocess
import time
import webbrowser
from collections.abc import Callable

from cmr.bus.message import Message
from cmr.bus.process import Process
from cmr.bus.streams import PROCESS_STATUS, WORLD_STATE
from cmr.cli.errors import CommandError
from cmr.cli.progress import Progress
from cmr.experiments.live.jobs import jobs_of
from cmr.experiments.live.preparing import prepare
from cmr.experiments.live.watch import TeamWatch
from cmr.experiments.team.plan import Scenario
from cmr.processes.children import Children, our_command

PAGE = "view"
START_UP = 240.0  # s until all processes are running, on a slow machine
PORTS = 60.0  # s until an emulator offers its ports
ENDING = 5.0  # s for a process that has the terminal to end
RATE = 20.0  # Hz
SERVED = re.compile(r"(http://\S+)  token for its buttons: (\S+)")  # printed by cmr-view at its start


class Demonstration:
    """The processes of a scenario, with files in the folder of `children`, on the bus of a process."""

    def __init__(self, process: Process, children: Children, scenario: Scenario) -> None:
        self._process, self._children = process, children
        self._scenario = prepare(scenario, children.folder)
        self._watch = TeamWatch(self._scenario)
        process.subscribe(WORLD_STATE)
        process.subscribe(PROCESS_STATUS, every=True)

    def _start(self) -> None:
        """Start all processes."""
        for job in jobs_of(self._scenario, self._children.folder, self._process.bus.url):
            if job.after is not None:
                self._wait(job.after.exists, PORTS, job.name)
            self._children.start(job.name, job.command)

    def _open_page(self, *options: str) -> tuple[str, str]:
        """Start cmr-view with these options, and show the scene in the browser; return its address and its token."""
        self._children.start(PAGE, [our_command("cmr-view"), *options, "--lcm-url", self._process.bus.url])
        found: list[str] = []

        def served() -> bool:
            match = SERVED.search(self._children.said(PAGE))
            found[:] = match.groups() if match else ()
            return bool(found)

        self._wait(served, START_UP, "the page")
        address, token = found
        webbrowser.open(address)
        return address, token

    def _end(self, process: "subprocess.Popen[bytes]") -> None:
        """End a process that has the terminal: request it, and give it time to restore the terminal."""
        process.terminate()
        try:
            process.wait(ENDING)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()

    def _wait(self, condition: Callable[[], bool], seconds: float, what: str) -> None:
        """Handle messages until a condition holds. Raises CommandError as `wait_for` does, and on a signal."""
        if not wait_for(condition, seconds, what, self._process, self._children, self._watch.handle):
            raise CommandError("Stopped.")


def wait_for(
    condition: Callable[[], bool],
    seconds: float,
    what: str,
    process: Process,
    children: Children,
    handle: Callable[[int, str, Message], object],
    expected: float | None = None,
) -> bool:
    """Dispatch messages to `handle` until a condition holds; return False if a signal comes first.

    Shows progress: `what`, as a share of the `expected` time [s] if that is known. Raises CommandError if a child
    process has failed, or after `seconds`.
    """
    began = time.monotonic()
    with Progress(expected, "s", lines=expected is not None) as progress:
        for _utime in process.loop(rate_hz=RATE):
            process.dispatch(handle)
            if condition():
                return True
            if failure := children.failed():
                raise CommandError(failure)
            waited = time.monotonic() - began
            if waited > seconds:
                raise CommandError(f"Gave up waiting for {what} after {seconds:.0f} s. See {children.folder}/*.txt.")
            progress.show(what if expected else f"Waiting for {what}", min(waited, expected or waited))
    return False
