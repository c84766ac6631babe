"""Which process commands the robot: the one that claimed it, and where nobody did, whether it is one alone.

An owner has the robot until it ends, falls silent or is replaced. Programs that claim nothing do not name themselves in
what they command, but two of them disagree. The commands of one change steadily from one to the next. Those of two
alternate: a command departs from the one before it, and the next one comes back.
"""

from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

from cmr.bus.messages import make
from cmr.bus.streams import COMMAND_LIFETIME
from cmr.msg import command_claim_t, command_owner_t
from cmr.plain_text import plain
from robot_driver.host import Host

LAPSE = 1.0  # s without a claim, after which somebody else may have the robot
PERIOD = 0.5  # s between reports
SHOWN = 5.0  # s for which a refusal stays reported, so that a person sees it
LONGEST_NAME = 120  # characters
NOBODY = 0  # as the sender of command_owner_t; also one without a name
UNNAMED = "a program without a name"
WINDOW = 1_000_000  # us
MOST = 10_000  # commands that are looked back upon: any number may have stamps within the window
FEWEST = 7  # departures and returns within the window; chance, noise and a single correction make fewer
SHARE = 0.1  # of all commands
DIFFERENT = 0.01  # duty; smaller differences do nothing to the robot
RETURN = 0.15  # of the departure, within which the next command has to be at the one before
REPORTED = 5_000_000  # us for which it stays reported, so that a person sees it


@dataclass
class _Owner:
    """Who has the robot: the name of its process, who it is for people, since when [us], and when it was last heard."""

    sender: int
    name: str
    since_utime: int
    heard: float  # s of the host's monotonic clock


class Ownership:
    """Decides by claims whose commands are taken. `news` is what happened, as a person wants to read it."""

    def __init__(self, robot_id: int, host: Host) -> None:
        self.news: list[str] = []
        self.commands_refused = 0
        self._robot_id, self._host = robot_id, host
        self._owner: _Owner | None = None
        self._refused = ""  # who was refused last
        self._refused_at = -SHOWN
        self._report_due = host.monotonic()

    def claim(self, message: command_claim_t, sender: int | None) -> None:
        """Take a claim. One that was made half a second ago, or will be, is of a log or of a wrong clock."""
        if abs(self._host.utime() - message.utime) > COMMAND_LIFETIME:
            return
        sender = sender or NOBODY
        owner = self._present_owner()
        name = plain(message.claimant, LONGEST_NAME) or UNNAMED
        if message.action == command_claim_t.END:
            if owner is not None and owner.sender == sender:
                self._own(None)
        elif owner is None or (message.action == command_claim_t.TAKE_OVER and owner.sender != sender):
            if owner is not None:
                self.news.append(f"{name} took over the robot from {owner.name}")
            self._own(_Owner(sender, name, self._host.utime(), self._host.monotonic()))
        elif owner.sender == sender:
            owner.heard = self._host.monotonic()
        else:
            self._refuse(name)

    def takes(self, sender: int | None) -> bool:
        """Return whether a command of this sender is taken, and count it if not."""
        owner = self._present_owner()
        if owner is None or owner.sender == (sender or NOBODY):
            return True
        self.commands_refused += 1
        if self._host.monotonic() >= self._refused_at + SHOWN:  # a claim said it by name
            self._refuse("a process that has not claimed it" if sender else UNNAMED)
        return False

    def reports(self) -> list[command_owner_t]:
        """Return what COMMAND_OWNER_N has to report now."""
        owner = self._present_owner()
        if self._host.monotonic() < self._report_due:
            return []
        self._report_due = self._host.monotonic() + PERIOD
        sender, name, since = (owner.sender, owner.name, owner.since_utime) if owner else (NOBODY, "", 0)
        report = make(
            command_owner_t,
            utime=self._host.utime(),
            robot_id=self._robot_id,
            sender=sender,
            owner=name,
            since_utime=since,
        )
        return [report]

    def problem(self) -> str:
        """Return who else wants to command the robot; empty if nobody did lately."""
        owner = self._present_owner()
        if owner is None or self._host.monotonic() > self._refused_at + SHOWN:
            return ""
        return (
            f"More than one process commands this robot: {owner.name} does, {self._refused} is refused. End one, or "
            "take over with cmr-pilot --take-over."
        )

    def _present_owner(self) -> _Owner | None:
        if self._owner is not None and self._host.monotonic() > self._owner.heard + LAPSE:
            self._own(None)
        return self._owner

    def _own(self, owner: _Owner | None) -> None:
        self._owner = owner
        self._refused_at = -SHOWN
        self._report_due = self._host.monotonic()

    def _refuse(self, name: str) -> None:
        self._refused, self._refused_at = name, self._host.monotonic()


class _Command(NamedTuple):
    utime: int
    left: float
    right: float


class Commanders:
    """Takes all commands of one robot, at whatever times [us] they were decided, in the order of arrival."""

    def __init__(self) -> None:
        self._recent: deque[_Command] = deque(maxlen=3)
        self._commands: deque[int] = deque(maxlen=MOST)
        self._departures: deque[int] = deque(maxlen=MOST)
        self._seen: int | None = None

    def take(self, utime: int, left: float, right: float) -> None:
        """Take a command."""
        self._recent.append(_Command(utime, left, right))
        self._commands.append(utime)
        if len(self._recent) == 3 and _departs(*self._recent):
            self._departures.append(utime)
        for times in (self._commands, self._departures):
            while times and abs(utime - times[0]) > WINDOW:  # also what one with another clock decided later
                times.popleft()
        if len(self._departures) >= max(FEWEST, SHARE * len(self._commands)):
            self._seen = utime

    def problem(self, utime: int) -> str:
        """Return that several processes command the robot; empty if it does not look so at `utime` [us]."""
        if self._seen is None or abs(utime - self._seen) > REPORTED:
            return ""
        return "More than one process commands this robot: end all but one. cmr-spy shows what is on the bus."


def _departs(before: _Command, between: _Command, after: _Command) -> bool:
    """Return whether the command between departs from the one before, and the one after comes back."""
    departure = max(abs(between.left - before.left), abs(between.right - before.right))
    back = max(abs(after.left - before.left), abs(after.right - before.right))
    return departure > DIFFERENT and back < RETURN * departure
