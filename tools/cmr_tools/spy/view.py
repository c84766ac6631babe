"""The display of cmr-spy, as lines of text: a table of channels, or one channel in detail; and its keys."""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple, TypedDict

import numpy as np

from cmr.bus.channel_statistics import Line
from cmr.bus.fields import fields_of
from cmr.bus.messages import MICROSECONDS, RejectedMessage, decode
from cmr.plain_text import plain
from cmr_tools.spy.statistics import type_name

HEAD = f"{'CHANNEL':24} {'TYPE':20} {'RATE':>7} {'kB/s':>7} {'AGE':>7} {'JITTER':>8} {'ERRORS':>6}  LAST VALUES"
KEYS = "arrows: choose, Return: details, /: filter, space: freeze, q: quit"
KEYS_OF_DETAILS = "Escape: back, space: freeze, q: quit"
KEYS_OF_FILTER = "Return: keep the filter, Escape: none"
NOT_SHOWN = ("utime", "robot_id")  # in the table: AGE and CHANNEL show them
LONGEST_TEXT = 60  # characters of a text field in the table
MOST_ELEMENTS = 4  # of an array in the table
ELEMENTS_IN_DETAIL = 200
ESCAPE = "\x1b"


class Row(NamedTuple):
    """One line on the screen; the chosen one is emphasised."""

    text: str
    chosen: bool = False


class View:
    """The displayed part of the lines that `lines()` returns, and how keys change that. `quit` is set by the key q.

    `fits` decides which channels may be shown.
    """

    def __init__(self, lines: Callable[[], list[Line]], fits: Callable[[str], bool] = lambda _channel: True) -> None:
        self.quit = False
        self._lines_now, self._fits = lines, fits
        self._frozen: list[Line] | None = None
        self._filter = ""
        self._typing = False
        self._chosen = ""
        self._details = False

    def screen(self, height: int, width: int) -> list[Row]:
        """Return the lines of the screen, `height` at most and `width` characters wide at most."""
        lines = self._lines()
        detailed = next((line for line in lines if self._details and line.channel == self._chosen), None)
        if detailed is None:
            body, keys = list(self._table(lines, height - 2)), KEYS_OF_FILTER if self._typing else KEYS
        else:
            body, keys = [Row(text) for text in details(detailed)], KEYS_OF_DETAILS
        rows = [Row(self._title(lines)), *body[: max(height - 2, 0)]]
        rows += [Row("")] * (height - 1 - len(rows))
        return [Row(text[:width], chosen) for text, chosen in [*rows, Row(keys)]][:height]

    def press(self, key: str) -> None:
        """Handle a key: a character, or up, down, left or right."""
        if self._typing:
            self._type(key)
        elif key == "q":
            self.quit = True
        elif key == " ":
            self._frozen = self._lines_now() if self._frozen is None else None
        elif key == "/":
            self._typing, self._details, self._filter = True, False, ""
        elif key in ("up", "down"):
            self._move(1 if key == "down" else -1)
        elif key in ("\n", "\r", "right"):
            self._details = bool(self._chosen)
        elif key in (ESCAPE, "left"):
            self._details = False

    def _type(self, key: str) -> None:
        if key == ESCAPE:
            self._typing, self._filter = False, ""
        elif key in ("\n", "\r"):
            self._typing = False
        elif key in ("\x7f", "\b"):
            self._filter = self._filter[:-1]
        elif len(key) == 1 and key.isprintable():
            self._filter += key

    def _move(self, step: int) -> None:
        names = [line.channel for line in self._lines()]
        if names:
            place = names.index(self._chosen) + step if self._chosen in names else 0
            self._chosen = names[min(max(place, 0), len(names) - 1)]

    def _lines(self) -> list[Line]:
        lines = self._lines_now() if self._frozen is None else self._frozen
        wanted = self._filter.lower()
        return [line for line in lines if wanted in line.channel.lower() and self._fits(line.channel)]

    def _title(self, lines: Sequence[Line]) -> str:
        total = f"{sum(line.rate for line in lines):.0f} messages/s, {_kilobytes(lines):.1f} kB/s"
        parts = [f"{len(lines)} channels, {total}"]
        if self._frozen is not None:
            parts.append("FROZEN")
        if self._typing or self._filter:
            parts.append(f"filter: {self._filter}{'_' if self._typing else ''}")
        return "   ".join(parts)

    def _table(self, lines: Sequence[Line], height: int) -> Iterator[Row]:
        yield Row(HEAD)
        place = next((place for place, line in enumerate(lines) if line.channel == self._chosen), 0)
        first = max(place - height + 2, 0)  # the chosen one stays on the screen
        for line in lines[first : first + max(height - 1, 0)]:
            yield Row(table_row(line), line.channel == self._chosen)


class Document(TypedDict):
    """The format of channels in docs/reference/json.md."""

    utime: int
    channels: dict[str, dict[str, object]]


def document(now: int, lines: Sequence[Line], fits: Callable[[str], bool]) -> Document:
    """Return all channels at `now` [us] for programs, in the format of docs/reference/json.md."""
    return {"utime": now, "channels": {line.channel: _of_channel(line) for line in lines if fits(line.channel)}}


def _of_channel(line: Line) -> dict[str, object]:
    try:
        received = decode(line.channel, line.data)
    except RejectedMessage:
        values = None
    else:
        fields = fields_of(received.stream.message_type)
        values = {field.name: _plain_value(getattr(received.message, field.name)) for field in fields}
    return {
        "type": type_name(line),
        "messages": line.messages,
        "rate": line.rate,
        "bytes_per_second": line.bytes_per_second,
        "age": line.age,
        "jitter": line.jitter,
        "errors": line.errors,
        "last": values,
    }


def _plain_value(value: object) -> object:
    """Return the value of a field for JSON: arrays as lists, and for bytes, such as a picture, their number."""
    if isinstance(value, bytes):
        return len(value)
    return value.tolist() if isinstance(value, np.ndarray) else value


def table(lines: Sequence[Line], fits: Callable[[str], bool]) -> list[str]:
    """Return the whole table as text."""
    return [HEAD, *(table_row(line) for line in lines if fits(line.channel))]


def table_row(line: Line) -> str:
    """Return one line of the table."""
    jitter = "" if math.isnan(line.jitter) else f"{1e3 * line.jitter:.1f} ms"
    return (
        f"{plain(line.channel):24} {type_name(line):20} {line.rate:7.1f} {line.bytes_per_second / 1e3:7.1f} "
        f"{_age(line.age):>7} {jitter:>8} {line.errors:6}  {_values(line)}"
    )


def details(line: Line) -> list[str]:
    """Return all data on a channel: statistics, and each field of the last message with its unit."""
    head = [
        f"{plain(line.channel)}   {type_name(line)}   {line.messages} messages, {line.errors} errors",
        f"{line.rate:.2f} Hz, {line.bytes_per_second / 1e3:.2f} kB/s, the last one {len(line.data)} bytes, "
        f"{_age(line.age)} ago; jitter {1e3 * line.jitter:.2f} ms",
    ]
    try:
        received = decode(line.channel, line.data)
    except RejectedMessage as rejected:
        return [*head, "", f"{rejected}", f"bytes: {line.data[:64].hex(' ')}"]
    message = received.message
    delay = _delay((line.utime - message.utime) / MICROSECONDS)
    fields = fields_of(received.stream.message_type)
    width = max(len(field.column) for field in fields)
    values = [
        f"  {field.column:{width}}  {_text(getattr(message, field.name), ELEMENTS_IN_DETAIL, 10 * LONGEST_TEXT)}"
        for field in fields
    ]
    return [*head, delay, "", *values]


def _values(line: Line) -> str:
    """Return the values of the last message in short, or the problem with it. Only displayed messages are decoded."""
    try:
        received = decode(line.channel, line.data)
    except RejectedMessage as rejected:
        if rejected.reason == "unknown_channel":
            return f"{len(line.data)} bytes"
        return str(rejected)
    names = [name for name in received.stream.message_type.__slots__ if name not in NOT_SHOWN]
    return " ".join(f"{name}={_text(getattr(received.message, name), MOST_ELEMENTS, LONGEST_TEXT)}" for name in names)


def _text(value: object, most: int, longest: int) -> str:
    if isinstance(value, str):
        return plain(value, longest)
    if isinstance(value, bytes):
        return f"{len(value)} bytes"
    if isinstance(value, float):
        return f"{value:.5g}"
    if isinstance(value, (int, bool)):
        return str(int(value))
    assert isinstance(value, Sequence | np.ndarray), "all others are arrays"
    shown = " ".join(f"{float(element):.5g}" for element in value[:most])
    return f"[{shown}{' ...' if len(value) > most else ''}]"


def _age(seconds: float) -> str:
    if seconds < 100.0:
        return f"{max(seconds, 0.0):.2f} s"
    return f"{seconds:.0f} s" if seconds < 10_000.0 else f"{seconds / 3600.0:.1f} h"


def _delay(seconds: float) -> str:
    """Say how long [s] before its arrival a message was stamped."""
    if abs(seconds) < 10.0:
        return f"stamped {1e3 * seconds:.1f} ms before it arrived"
    when = "before" if seconds > 0.0 else "later than"
    return f"stamped {_age(abs(seconds))} {when} it arrived: recorded at another time, or clocks differ"


def _kilobytes(lines: Sequence[Line]) -> float:
    return sum(line.bytes_per_second for line in lines) / 1e3
