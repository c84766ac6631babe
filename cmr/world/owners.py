"""Ownership of virtual robots: a simulator decides it by claims, as the driver of a real robot does."""

import time
from collections.abc import Collection, Iterator

from cmr.bus.claiming import Clocks, Ownership
from cmr.bus.message import Message
from cmr.bus.messages import now_utime
from cmr.bus.streams import identify
from cmr.msg import command_claim_t, command_owner_t
from cmr.recordings.commanding import COMMANDS


class _ThisHost:
    """The clocks of this computer."""

    def utime(self) -> int:
        """Return the time of day [us]."""
        return now_utime()

    def monotonic(self) -> float:
        """Return the time [s] of a monotonic clock."""
        return time.monotonic()


class Owners:
    """The owners of the virtual robots `robot_ids`. Anybody may command a robot that was never claimed."""

    def __init__(self, robot_ids: Collection[int], clocks: Clocks | None = None) -> None:
        self._robot_ids = frozenset(robot_ids)
        self._clocks = clocks or _ThisHost()
        self._claimed: dict[int, Ownership] = {}

    def takes(self, channel: str, message: Message, sender: int | None) -> bool:
        """Handle a message; return whether to pass it to the world: claims and refused commands are not passed."""
        robot_id = (identify(channel) or (None, None))[1]
        if robot_id not in self._robot_ids or robot_id is None:
            return True
        if isinstance(message, command_claim_t):
            self._claimed.setdefault(robot_id, Ownership(robot_id, self._clocks)).claim(message, sender)
            return False
        owner = self._claimed.get(robot_id) if isinstance(message, COMMANDS) else None
        return owner is None or owner.takes(sender)

    def reports(self) -> Iterator[command_owner_t]:
        """Yield the COMMAND_OWNER_N messages that are due now."""
        for owner in self._claimed.values():
            yield from owner.reports()

    def news(self) -> Iterator[str]:
        """Yield sentences about changes of owner."""
        for robot_id, owner in self._claimed.items():
            while owner.news:
                yield f"robot {robot_id}: {owner.news.pop(0)}"

    def problem(self) -> str:
        """Return a sentence on a process that was refused a robot; empty without a recent one."""
        return next((text for owner in self._claimed.values() if (text := owner.problem())), "")
