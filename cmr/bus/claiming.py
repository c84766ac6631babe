"""How a process claims a robot that it commands, and learns whether it has it."""

import os
import socket
from collections.abc import Callable

from cmr.bus.message import Message
from cmr.bus.messages import make
from cmr.msg import command_claim_t, command_owner_t

PERIOD = 200_000  # us between claims; a driver forgets an owner after five that it did not hear
OLDEST = 2_000_000  # us; a driver reports four times in it


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
