"""cmr estop: engage the emergency stop of all real robots, release it, or show which robots it holds."""

import argparse
import getpass
import socket
import time
from collections.abc import Callable

from cmr.bus.bus import Bus
from cmr.bus.estop import local_time
from cmr.bus.messages import make, now_utime
from cmr.bus.streams import ESTOP, ESTOP_LATCH
from cmr.cli.command_line import parser
from cmr.cli.errors import CommandError
from cmr.msg import estop_latch_t, estop_t

STATUS, STOP, RELEASE = "status", "stop", "release"
REPEATED_EVERY = 0.05  # s
RELEASED_FOR = 0.4  # s; drivers take a release for 0.5 s after it was decided
STOPPED_FOR = 1.0  # s, so that a receiver that has lost some messages does not miss it
HEARING = 1.2  # s, in which every driver reports twice
NOBODY = (
    "No driver reports on this bus. An engaged stop holds until a running driver accepts its release: start the "
    "drivers first, or check that --lcm-url is theirs."
)


def main(arguments: list[str]) -> int:
    """Run cmr estop.

    Raises CommandError if no driver carries out the request, BusError when the bus cannot be used.
    """
    options = _options(arguments)
    drivers = Drivers(options.lcm_url)
    if options.action == STOP:
        drivers.send(True, options.name, options.reason, STOPPED_FOR)
        drivers.listen(HEARING, until=lambda: drivers.all_are(engaged=True))
    else:
        drivers.listen(HEARING)
    if options.action == RELEASE:
        drivers.send(False, options.name, options.reason, RELEASED_FOR)
        drivers.listen(HEARING, until=lambda: drivers.all_are(engaged=False))
    for report in drivers.reports():
        print(sentence(report))
    if failure := drivers.failure(options.action):
        raise CommandError(failure)
    return 0


def command_parser() -> argparse.ArgumentParser:
    """Return the command line of cmr estop."""
    result = parser(
        "cmr estop",
        "Engage the emergency stop of all real robots on the bus, release it, or show which robots it holds, since "
        "when, by whom and why. It holds until it is released, also over restarts of drivers and computers. A "
        "release needs a reason. After that a robot waits for a zero command, and then moves as commanded.",
        'cmr estop\n  cmr estop stop --reason "smoke"\n  cmr estop release --reason "wheel freed, floor is clear"',
    )
    result.add_argument(
        "action", nargs="?", choices=(STATUS, STOP, RELEASE), default=STATUS, help=f"what to do (default: {STATUS})"
    )
    result.add_argument("--reason", metavar="TEXT", help=f"the reason, for the record; required for {RELEASE}")
    result.add_argument("--name", metavar="NAME", help="your name (default: your name on this computer)")
    return result


def sentence(report: estop_latch_t) -> str:
    """Describe a driver's report on its robot."""
    robot = f"robot {report.robot_id}:"
    if report.engaged:
        kept = "" if report.stored else " (not on the disk of its driver)"
        said = f"{robot} HELD since {local_time(report.since_utime)} by {report.source}: {report.reason}{kept}"
    elif report.since_utime:
        said = f"{robot} free, released {local_time(report.since_utime)} by {report.source}: {report.reason}"
    else:
        said = f"{robot} free"
    return "".join(letter if letter.isprintable() else "?" for letter in said)


class Drivers:
    """The drivers on a bus, from their reports on the emergency stop. Raises BusError when it cannot be used."""

    def __init__(self, url: str | None) -> None:
        self._bus = Bus(url)
        self._bus.subscribe(ESTOP_LATCH, every=True)
        self._reports: dict[int, estop_latch_t] = {}

    def send(self, engaged: bool, name: str, reason: str, seconds: float) -> None:
        """Engage or release the stop repeatedly for `seconds`, and listen meanwhile.

        A release keeps the time of its decision, so that a stop engaged after it stays engaged.
        """
        decided, end = now_utime(), time.monotonic() + seconds
        while time.monotonic() < end:
            utime = now_utime() if engaged else decided
            self._bus.publish(ESTOP, make(estop_t, utime=utime, engaged=engaged, source=name, reason=reason))
            self.listen(REPEATED_EVERY)

    def listen(self, seconds: float, until: Callable[[], bool] = lambda: False) -> None:
        """Listen for `seconds`, or until a condition holds."""
        end = time.monotonic() + seconds
        while (remaining := end - time.monotonic()) > 0.0 and not until():
            for received in self._bus.receive(min(remaining, REPEATED_EVERY)):
                if isinstance(received.message, estop_latch_t):
                    self._reports[received.message.robot_id] = received.message

    def reports(self) -> list[estop_latch_t]:
        """Return the last report of each driver, in order of robots."""
        return [self._reports[robot_id] for robot_id in sorted(self._reports)]

    def all_are(self, *, engaged: bool) -> bool:
        """Return whether there are drivers, and all hold their robots, or none does."""
        return bool(self._reports) and all(bool(report.engaged) == engaged for report in self._reports.values())

    def failure(self, action: str) -> str:
        """Return why something was not done; empty if it was."""
        if not self._reports:
            return NOBODY
        if action == STOP and not self.all_are(engaged=True):
            return "Not every robot is held. Use the hardware stop."
        if action == RELEASE and not self.all_are(engaged=False):
            return (
                "Not every robot is released: somebody still engages the stop, or the clocks of the computers differ "
                "by more than 0.5 s. The driver's line on PROCESS_STATUS says which."
            )
        return ""


def _options(arguments: list[str]) -> argparse.Namespace:
    result = command_parser()
    options = result.parse_args(arguments)
    if options.action == RELEASE and not (options.reason or "").strip():
        result.error("release needs --reason TEXT, to record why the robots may move again")
    options.reason = options.reason or "the command cmr estop"
    options.name = (options.name or "").strip() or f"{_user()} on {socket.gethostname()}"
    return options


def _user() -> str:
    """Return the name of the user."""
    try:
        return getpass.getuser()
    except (KeyError, OSError):  # a user without a name, as in a container
        return "somebody"
