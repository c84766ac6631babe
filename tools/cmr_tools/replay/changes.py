"""Changes that a replay makes to a message: its channel, its robot id, and its times."""

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from struct import Struct
from typing import NamedTuple

from cmr.bus.message import FINGERPRINT_BYTES
from cmr.bus.older import as_of_today
from cmr.bus.streams import SELF_TESTS, identify
from cmr.bus.wire import TYPES, offsets
from cmr.recordings.events import Event
from cmr_tools.events import channel_chooser

UTIME = Struct(">q")
LARGEST_UTIME = 2**63 - 1  # limit of int64


class ChannelFilter:
    """Decides whether a channel is replayed: one of the shell patterns `only`, or any; but none of `without`.

    Messages that test the bus are never replayed. `seen` has each channel checked so far, and the answer.
    """

    def __init__(self, only: Sequence[str], without: Sequence[str]) -> None:
        self.seen: dict[str, bool] = {}
        self._fits = channel_chooser(only)
        self._is_left_out = channel_chooser([*without, *SELF_TESTS])

    def __call__(self, channel: str) -> bool:
        """Return whether this channel is replayed."""
        if channel not in self.seen:
            self.seen[channel] = self._fits(channel) and not self._is_left_out(channel)
        return self.seen[channel]


class _Plan(NamedTuple):
    """The changes to messages of one type on a channel."""

    channel: str
    robot_id: bytes | None
    robot_id_offset: int
    utime_offsets: tuple[int, ...]
    needed: int  # bytes; shorter messages are damaged


class Changes:
    """Renames channels by `remap`. If both names belong to one stream, the messages get the new robot's id, too."""

    def __init__(self, remap: Mapping[str, str]) -> None:
        self._remap = dict(remap)
        self._plan_of = lru_cache(maxsize=None)(self._make_plan)

    def changed(self, event: Event, new_utime: Callable[[int], int] | None = None) -> tuple[str, bytes]:
        """Return the channel and the message to send; `new_utime` converts each time [us] in the message.

        Messages of foreign types, and those that are too short, are not changed.
        """
        data = as_of_today(event.data)
        plan = self._plan_of(event.channel, data[:FINGERPRINT_BYTES])
        if len(data) < plan.needed or not (plan.robot_id or new_utime):
            return plan.channel, data
        changed = bytearray(data)
        if plan.robot_id is not None:
            changed[plan.robot_id_offset : plan.robot_id_offset + 4] = plan.robot_id
        if new_utime is not None:
            for offset in plan.utime_offsets:
                [utime] = UTIME.unpack_from(data, offset)
                if utime:  # 0 marks an unknown time
                    moved = min(max(new_utime(utime), -LARGEST_UTIME), LARGEST_UTIME)
                    UTIME.pack_into(changed, offset, moved)
        return plan.channel, bytes(changed)

    def _make_plan(self, channel: str, fingerprint: bytes) -> _Plan:
        new = self._remap.get(channel, channel)
        message_type = TYPES.get(fingerprint)
        places = offsets(message_type) if message_type is not None else {}
        utimes = tuple(offset for name, offset in places.items() if name.endswith("utime"))
        robot_id = None
        before, after = identify(channel), identify(new)
        if "robot_id" in places and before and after and before[0] is after[0] and before[1] != after[1]:
            robot_id = (after[1] or 0).to_bytes(4, "big")
        ends = [offset + 8 for offset in utimes] + ([places["robot_id"] + 4] if robot_id else [])
        return _Plan(new, robot_id, places.get("robot_id", 0), utimes, max(ends, default=0))


def moved_to(due_utime: int, event_utime: int, speed: float) -> Callable[[int], int]:
    """Return a function that shifts times [us] of a message logged at `event_utime` to when it is due.

    Its age when sent is then that when logged, or less at a higher speed, so that the order of times within a channel
    is kept.
    """
    if speed <= 1.0:
        shift = due_utime - event_utime
        return lambda utime: utime + shift
    return lambda utime: due_utime + round((utime - event_utime) / speed)
