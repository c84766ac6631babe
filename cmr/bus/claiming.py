"""How a process claims the robot that it commands, and how the driver or simulator decides who owns the robot.

An owner keeps the robot until it exits, falls silent or is replaced.
"""

import os
import socket
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from cmr.bus.message import Message
from cmr.bus.messages import make
from cmr.bus.streams import COMMAND_LIFETIME
from cmr.msg import command_claim_t, command_owner_t
from cmr.plain_text import plain

PERIOD = 200_000  # us between claims; a driver drops an owner after five missed claims
OLDEST = 2_000_000  # us; maximum age of a report; a driver sends four in that time
LAPSE = 1.0  # s without a claim, after which another process may take the robot
REPORT_PERIOD = 0.5  # s between reports
SHOWN = 5.0  # s for which a refusal is reported, long enough to be read
LONGEST_NAME = 120  # characters
NOBODY = 0  # sender in command_owner_t when nobody owns the robot, or when the owner has no name
UNNAMED = "a program without a name"


class Claim:
    """The claim of one process to one robot; `sender` returns the name that signs the process's commands.

    With `take_over` the claim once replaces the current owner. If the driver reports no owner, or there is no driver,
    the process may command the robot without a grant. `lost_to` names the process that took the robot over.
    """

    def __init__(self, process: str, robot_id: int, sender: Callable[[], int], take_over: bool = False) -> None:
        self.claimant = f"{process} on {socket.gethostname()} (process {os.getpid()})"
        self.lost_to = ""
        self._robot_id, self._sender, self._taking_over = robot_id, sender, take_over
        self._owner: command_owner_t | None = None
        self._was_mine = False
        self._due = 0

    def handle(self, _utime: int, _channel: str, message: Message) -> None:
        """Handle the driver's ownership report; ignore other messages."""
        if not isinstance(message, command_owner_t) or message.robot_id != self._robot_id:
            return
        self._owner = message
        if self._is_mine(message):
            self._taking_over, self._was_mine = False, True
        elif self._was_mine and message.owner:
            self.lost_to = message.owner

    def others(self, utime: int) -> str:
        """Return the other current owner, from a recent report; empty if there is none or it is being replaced."""
        owner = self._owner
        if owner is None or self._taking_over or self._is_mine(owner) or utime - owner.utime > OLDEST:
            return ""
        return owner.owner

    def _is_mine(self, owner: command_owner_t) -> bool:
        return bool(owner.owner) and owner.sender == self._sender()

    def message(self, utime: int) -> command_claim_t | None:
        """Return the claim if one is due."""
        if self.lost_to or self._due - PERIOD <= utime < self._due:
            return None
        self._due = utime + PERIOD
        return self._made(utime, command_claim_t.TAKE_OVER if self._taking_over else command_claim_t.CLAIM)

    def end(self, utime: int) -> command_claim_t:
        """Return the message that releases the robot."""
        return self._made(utime, command_claim_t.END)

    def _made(self, utime: int, action: int) -> command_claim_t:
        return make(command_claim_t, utime=utime, robot_id=self._robot_id, action=action, claimant=self.claimant)


class Clocks(Protocol):
    """The clocks of the process that moves the robot."""

    def utime(self) -> int:
        """Return the time of day [us]."""

    def monotonic(self) -> float:
        """Return the time [s] of a monotonic clock."""


@dataclass
class _Owner:
    """The owner of a robot: its process's name, a readable description, since when [us], and when it was last heard."""

    sender: int
    name: str
    since_utime: int
    heard: float  # s of the host's monotonic clock


class Ownership:
    """Decides from claims whose commands are accepted. `news` are sentences about changes of owner."""

    def __init__(self, robot_id: int, host: Clocks) -> None:
        self.news: list[str] = []
        self.commands_refused = 0
        self._robot_id, self._host = robot_id, host
        self._owner: _Owner | None = None
        self._refused = ""  # the process refused last
        self._refused_at = -SHOWN
        self._report_due = host.monotonic()

    def claim(self, message: command_claim_t, sender: int | None) -> None:
        """Handle a claim. A stamp more than half a second from now comes from a log or a wrong clock."""
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
        """Return whether commands of this sender are accepted, and count the command if not."""
        owner = self._present_owner()
        if owner is None or owner.sender == (sender or NOBODY):
            return True
        self.commands_refused += 1
        if self._host.monotonic() >= self._refused_at + SHOWN:  # a claim has already been refused by name
            self._refuse("a process that has not claimed it" if sender else UNNAMED)
        return False

    def reports(self) -> list[command_owner_t]:
        """Return the COMMAND_OWNER_N messages that are due now."""
        owner = self._present_owner()
        if self._host.monotonic() < self._report_due:
            return []
        self._report_due = self._host.monotonic() + REPORT_PERIOD
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
        """Return a sentence on another process that tries to command the robot; empty if none did recently."""
        owner = self._present_owner()
        if owner is None or self._host.monotonic() > self._refused_at + SHOWN:
            return ""
        return (
            f"More than one process commands this robot: {owner.name} does, {self._refused} is refused. End one, or "
            "take over with --take-over."
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
