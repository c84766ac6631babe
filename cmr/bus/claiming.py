"""How a process claims a robot that it commands, and how whoever moves the robot decides who has it.

An owner has the robot until it ends, falls silent or is replaced.
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

PERIOD = 200_000  # us between claims; a driver forgets an owner after five that it did not hear
OLDEST = 2_000_000  # us; a driver reports four times in it
LAPSE = 1.0  # s without a claim, after which somebody else may have the robot
REPORT_PERIOD = 0.5  # s between reports
SHOWN = 5.0  # s for which a refusal stays reported, so that a person sees it
LONGEST_NAME = 120  # characters
NOBODY = 0  # as the sender of command_owner_t; also one without a name
UNNAMED = "a program without a name"


class Claim:
    """The claim of one process to one robot; `sender` returns the name of that process under its commands.

    With `take_over` the robot is taken from whoever has it, once. A robot whose driver reports no owner, or which has
    no driver, is commanded without having been granted. `lost_to` says who took the robot over.
    """

    def __init__(self, process: str, robot_id: int, sender: Callable[[], int], take_over: bool = False) -> None:
        self.claimant = f"{process} on {socket.gethostname()} (process {os.getpid()})"
        self.lost_to = ""
        self._robot_id, self._sender, self._taking_over = robot_id, sender, take_over
        self._owner: command_owner_t | None = None
        self._was_mine = False
        self._due = 0

    def handle(self, _utime: int, _channel: str, message: Message) -> None:
        """Take what the driver reports; other messages are passed over."""
        if not isinstance(message, command_owner_t) or message.robot_id != self._robot_id:
            return
        self._owner = message
        if self._is_mine(message):
            self._taking_over, self._was_mine = False, True
        elif self._was_mine and message.owner:
            self.lost_to = message.owner

    def others(self, utime: int) -> str:
        """Return who else has the robot, as was reported lately; empty if nobody has, or it is being taken over."""
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
        """Return the message that leaves the robot to others."""
        return self._made(utime, command_claim_t.END)

    def _made(self, utime: int, action: int) -> command_claim_t:
        return make(command_claim_t, utime=utime, robot_id=self._robot_id, action=action, claimant=self.claimant)


class Clocks(Protocol):
    """The clocks of whoever moves the robot."""

    def utime(self) -> int:
        """Return the time of day [us]."""

    def monotonic(self) -> float:
        """Return the time [s] of a clock that nobody sets."""


@dataclass
class _Owner:
    """Who has the robot: the name of its process, who it is for people, since when [us], and when it was last heard."""

    sender: int
    name: str
    since_utime: int
    heard: float  # s of the host's monotonic clock


class Ownership:
    """Decides by claims whose commands are taken. `news` is what happened, as a person wants to read it."""

    def __init__(self, robot_id: int, host: Clocks) -> None:
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
        """Return who else wants to command the robot; empty if nobody did lately."""
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
