"""Fields of messages over time: those named on the command line, and their values in a log."""

import re
from collections.abc import Iterable
from difflib import get_close_matches
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmr.bus.fields import BYTES, ROBOTS, Field, FieldName, fields_on, number_in
from cmr.bus.messages import MICROSECONDS, RejectedMessage, decode
from cmr.cli.errors import CommandError
from cmr.recordings.events import Event
from cmr.recordings.thinning import Rows

WRITTEN = re.compile(r"([^.:]+)\.(\w+)(?:\[(?:(robot|twin) ?)?(\d+)\])?")
MOST_NEAR_NAMES = 5
MOST_ROWS = 500_000  # messages per channel whose values are kept: more than an hour at 100 Hz
MOST_VALUES = 4_000_000  # of all fields


class Values(NamedTuple):
    """Values of a field [unit] and their times [s since the log began], both of shape (n,)."""

    seconds: NDArray[np.float64]
    values: NDArray[np.float64]


def parse_field(text: str) -> FieldName:
    """Return the field named in a form such as POSE_0.x, WAYPOINTS_0.x[3], WORLD_STATE.x[robot 3] or [twin 3].

    Raises CommandError, with similar names, if the form is wrong or the field cannot be drawn.
    """
    match = WRITTEN.fullmatch(text)
    if match is None:
        raise CommandError(
            f"{text!r} is neither a file nor a field. A field is CHANNEL.FIELD, such as POSE_0.x or "
            "'WORLD_STATE.x[robot 3]'."
        )
    name = FieldName(match[1], match[2], int(match[4]) if match[4] else None, match[3] or "")
    known = fields_on(name.channel)
    if known is None:  # not a channel of CMR; the log gives similar names
        return name
    field = known.get(name.field)
    if field is None or field.wire_type in ("string", BYTES):
        near = near_names(str(name), [name.channel])
        why = "has no such field" if field is None else "has text there"
        raise CommandError(f"{name.channel} {why}: {name.field}. It has {', '.join(near)}.")
    _check_element(name, field, has_robots=ROBOTS in known)
    return name


def _check_element(name: FieldName, field: Field, *, has_robots: bool) -> None:
    """Raise CommandError if the brackets are missing, or do not fit the field."""
    written = f"{name.channel}.{name.field}"
    if field.counted_by is None and name.element is not None:
        raise CommandError(f"{written} is one number; leave out the brackets.")
    if field.counted_by is not None and name.element is None:
        example = "robot 0" if has_robots else "0"
        raise CommandError(f"{written} has many elements; name one, such as '{written}[{example}]'.")
    if name.whose and not has_robots:
        raise CommandError(f"{written} has elements by number, not by robot; name one, such as '{written}[0]'.")


def near_names(asked: str, channels: Iterable[str]) -> list[str]:
    """Return the fields of these channels with the most similar names; all of them if there are few."""
    names = [
        f"{channel}.{field.name}" + ("" if field.counted_by is None else "[0]")
        for channel in sorted(channels)
        for field in (fields_on(channel) or {}).values()
        if field.wire_type not in ("string", BYTES)
    ]
    near = get_close_matches(asked, names, MOST_NEAR_NAMES, cutoff=0.6)
    few = names if len(set(channels)) == 1 else []
    return near + [name for name in few if name not in near]


class Gathered:
    """The values of some fields in the events of one log; `channels` lists its channels, `rejected` counts damaged
    messages.

    If there are very many messages, only those with the lowest and highest values of each few are kept.
    """

    def __init__(self, names: Iterable[FieldName], events: Iterable[Event]) -> None:
        self.channels: set[str] = set()
        self.rejected = 0
        self._begin: int | None = None
        self._wanted: dict[str, list[FieldName]] = {}
        for name in names:
            self._wanted.setdefault(name.channel, []).append(name)
        most = min(MOST_VALUES // max(sum(map(len, self._wanted.values())), 1), MOST_ROWS)
        self._rows = {channel: Rows(len(fields), most) for channel, fields in self._wanted.items()}
        for event in events:
            if self._begin is None:
                self._begin = event.utime
            self.channels.add(event.channel)
            if event.channel in self._wanted:
                self._take(event)

    def values(self, name: FieldName) -> Values:
        """Return the values of a field, in order of time."""
        utime, values = self._rows[name.channel].all()
        order = np.argsort(utime, kind="stable")
        column = values[:, self._wanted[name.channel].index(name)]
        if name.whose:  # messages without this robot do not make gaps
            order = order[~np.isnan(column[order])]
        return Values((utime[order] - (self._begin or 0)) / MICROSECONDS, column[order])

    def _take(self, event: Event) -> None:
        try:
            message = decode(event.channel, event.data).message
        except RejectedMessage:
            self.rejected += 1
            return
        row = [number_in(message, name) for name in self._wanted[event.channel]]
        self._rows[event.channel].add(message.utime, row)


def against(horizontal: Values, vertical: Values) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return one field's values and the other's at the same times, interpolated if their times differ."""
    if np.array_equal(horizontal.seconds, vertical.seconds):
        return horizontal.values, vertical.values
    if not (len(horizontal.seconds) and len(vertical.seconds)):
        return np.empty(0), np.empty(0)
    other = np.interp(horizontal.seconds, vertical.seconds, vertical.values, left=np.nan, right=np.nan)
    return horizontal.values, other
