"""The robots of other simulators in the same world: received on WORLD_STATE and shown, but not simulated here.

A world_state_t does not contain its sender. Robots that this simulator does not own belong to others. If another
simulator sends a robot that this one owns, both report the conflict.
"""

from collections.abc import Iterable
from typing import NamedTuple, TypeAlias

import numpy as np

from cmr.bus.state_table import Integers, StateTable
from cmr.model.motion import RobotState
from cmr.msg import world_state_t
from cmr.world.view import Robots, numbers_of

Members: TypeAlias = tuple[tuple[int, ...], tuple[int, ...]]  # robot ids, and their origins

LOST = 1_000_000  # us; a robot without newer data is no longer shown
MEMORY = 10_000_000  # us for which sent messages are remembered; no network delays a message for longer
SPOKEN_OF = 2_000_000  # us for which a problem is reported after it was noticed
MOST_GROUPS = 1_000  # different sets of robots in a message; only senders that change them constantly need more
MOST_NAMED = 5  # robots in a sentence


class RemoteRobots:
    """The robots of other simulators; `own` are the ids of this simulator's, to which `claim` adds.

    Call `sent` for each message that this simulator publishes; `handle` receives WORLD_STATE, including its own
    messages, which the bus returns.
    """

    def __init__(self, own: Iterable[int]) -> None:
        self._own = set(own)
        self._table = StateTable(len(RobotState._fields))
        self._groups: dict[Members, _Group] = {}
        self._sent: dict[int, None] = {}
        self._doubled: dict[int, int] = {}
        self._clock = (0, 0)  # when a stamp last differed too much from this host's clock, and its lead [us]

    def claim(self, robot_id: int) -> None:
        """Mark a robot as owned by this simulator."""
        self._own.add(robot_id)
        self._groups.clear()

    def leave(self, robot_id: int) -> None:
        """Mark a robot as no longer owned by this simulator."""
        self._own.discard(robot_id)
        self._groups.clear()

    def sent(self, utime: int) -> None:
        """Record that this simulator publishes a WORLD_STATE stamped `utime` [us]."""
        self._sent[utime] = None
        while abs(utime - (oldest := next(iter(self._sent)))) > MEMORY:
            del self._sent[oldest]

    def handle(self, now: int, message: world_state_t) -> Robots | None:
        """Handle a world_state_t at `now` [us]; return the newer states of other simulators' robots in it, or None.

        Messages may come late, twice or in another order than they were sent.
        """
        group = self._group((numbers_of(message.robot_id), numbers_of(message.origin)))
        if group.own and not len(group.rows) and message.utime in self._sent:
            return None  # our own message, returned by the bus
        if abs(message.utime - now) > LOST:
            self._clock = (now, message.utime - now)
            return None
        self._doubled.update(dict.fromkeys(group.own, now))
        age = message.utime - self._table.utime[group.rows]
        news = (age > 0) | (age < -LOST)  # or the other host's clock was set back
        if not news.any():
            return None
        rows = group.rows[news]
        state = np.array([getattr(message, name) for name in RobotState._fields])[:, group.columns[news]]
        self._table.utime[rows] = message.utime
        self._table.state[:, rows] = state
        return Robots(*(group.members if news.all() else self._members(rows)), RobotState(*state))

    def robots(self, now: int) -> Robots:
        """Return the last states of other simulators' robots that were received within the last second."""
        heard = np.flatnonzero(now - self._table.utime <= LOST)
        return Robots(*self._members(heard), RobotState(*self._table.state[:, heard]))

    def problems(self, now: int) -> list[str]:
        """Return sentences about problems in sharing the world; empty if there are none."""
        doubled = sorted(robot_id for robot_id, heard in self._doubled.items() if now - heard <= SPOKEN_OF)
        sentences = []
        if doubled:
            sentences.append(
                f"Another cmr-sim publishes {named(doubled)}, too. Every robot belongs to one simulator: "
                "give it to one of them (--virtual, --real)."
            )
        noticed, ahead = self._clock
        if noticed and now - noticed <= SPOKEN_OF:
            sentences.append(
                "Robots of another cmr-sim are not shown: their stamps are more than 1 s "
                f"{'ahead of' if ahead > 0 else 'behind'} this host's clock. Set the clocks of both hosts (chrony)"
                f"{'.' if ahead > 0 else ', or give that cmr-sim less to do.'}"
            )
        return sentences

    def _group(self, members: Members) -> "_Group":
        """Return the group of robots that come in one message."""
        if members not in self._groups:
            if len(self._groups) >= MOST_GROUPS:
                self._groups.clear()
            ids = members[0]
            columns = np.array([i for i, robot_id in enumerate(ids) if robot_id not in self._own], np.int64)
            rows = self._table.rows(*(np.array(numbers, np.int64)[columns] for numbers in members))
            own = tuple(robot_id for robot_id in ids if robot_id in self._own)
            self._groups[members] = _Group(self._members(rows), own, columns, rows)
        return self._groups[members]

    def _members(self, rows: Integers) -> Members:
        """Return the ids and the origins of robots."""
        return numbers_of(self._table.robot_id[rows].tolist()), numbers_of(self._table.origin[rows].tolist())


class _Group(NamedTuple):
    """Robots that come in one message: `members` are those of others, in `columns` of it, kept in `rows` here."""

    members: Members
    own: tuple[int, ...]
    columns: Integers
    rows: Integers


def named(robot_ids: list[int]) -> str:
    """Return the robots' names for a sentence: `robot 3`, or `robots 3, 4, 5, 6, 7 and 17 more`."""
    shown = ", ".join(map(str, robot_ids[:MOST_NAMED]))
    more = f" and {len(robot_ids) - MOST_NAMED} more" if len(robot_ids) > MOST_NAMED else ""
    return f"robot{'s' if len(robot_ids) > 1 else ''} {shown}{more}"
