"""Signals that a visitor can plot: every number in every received message, named as in `cmr-plot`."""

from collections.abc import Iterable
from typing import NamedTuple

from cmr.bus.fields import BYTES, ROBOTS, FieldName, fields_on
from cmr.bus.streams import WORLD_STATE, identify
from cmr.view.data.robots import TWIN, Robots

MOST_ROBOTS = 500  # of WORLD_STATE that are offered; a longer list is unusable
MOST_ELEMENTS = 400  # of an array that are offered
NOT_PLOTTED = ("utime", "robot_id", "n")  # the horizontal axis itself, and constants


class Source(NamedTuple):
    """A source of signals: a channel, or one robot or twin (`whose`) of a channel about many.

    For arrays, `elements` of each can be chosen.
    """

    channel: str
    whose: str = ""
    robot_id: int | None = None
    elements: int = 1

    def __str__(self) -> str:
        return f"{self.channel} {self.whose} {self.robot_id}" if self.whose else self.channel

    def signals(self) -> tuple[FieldName, ...]:
        """Return its signals, in the order of the message."""
        fields = [
            field for field in (fields_on(self.channel) or {}).values() if field.wire_type not in ("string", BYTES)
        ]
        found: list[FieldName] = []
        for field in fields:
            if field.name in NOT_PLOTTED or (self.whose and field.name == ROBOTS):
                continue
            if field.counted_by is None:
                found.append(FieldName(self.channel, field.name))
            elif self.whose:
                found.append(FieldName(self.channel, field.name, self.robot_id, self.whose))
            else:
                elements = range(min(self.elements, MOST_ELEMENTS))
                found += [FieldName(self.channel, field.name, element) for element in elements]
        return tuple(found)


def sources(channels: Iterable[str], robots: Robots, elements: dict[str, int]) -> list[Source]:
    """Return the sources on these channels and among these robots, ordered by name and robot id.

    `elements` is the length of arrays, by channel.
    """
    found = [Source(channel, elements=elements.get(channel, 1)) for channel in sorted(channels, key=_by_robot)]
    found = [source for source in found if source.channel != WORLD_STATE.name and source.signals()]
    if WORLD_STATE.name in channels:
        kinds = zip(robots.robot_id.tolist(), robots.origin.tolist(), strict=True)
        for robot_id, origin in sorted(kinds)[:MOST_ROBOTS]:
            found.append(Source(WORLD_STATE.name, "twin" if origin == TWIN else "robot", robot_id))
    return found


def _by_robot(channel: str) -> tuple[str, int]:
    stream, robot_id = identify(channel) or (None, None)
    return (channel, -1) if stream is None or robot_id is None else (stream.name, robot_id)
