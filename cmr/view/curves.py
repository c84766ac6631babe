"""Signals over time for visitors: recorded live from the bus, or read from a whole log.

Memory is bounded: MOST_SIGNALS curves for all visitors of the same world or log; live with MOST_LIVE values of 16 bytes
each, from a log with MOST_OF_LOG and, while reading, ROWS_AT_ONCE more. Together that is at most 20 MB.
"""

import time
from collections.abc import Iterable, Iterator
from typing import NamedTuple, Protocol

import numpy as np

from cmr.bus.fields import FieldName, number_in
from cmr.bus.messages import MICROSECONDS, RejectedMessage, decode
from cmr.recordings.events import Event
from cmr.recordings.log_clock import measured_at
from cmr.recordings.thinning import Rows
from cmr.view.data.log_index import LogIndex
from cmr.view.data.robots import Floats, Integers

MOST_SIGNALS = 16
MOST_LIVE = 30_000  # values: the longest window of 300 s at 100 Hz; for faster channels the last ones are shown
MOST_OF_LOG = 20_000  # values; for longer logs minima and maxima are kept, so that spikes stay visible
LIVE_WINDOWS = {"last 10 s": 10.0, "last 30 s": 30.0, "last 60 s": 60.0, "last 5 min": 300.0}
WHOLE = "whole log"
LOG_WINDOWS = {WHOLE: 0.0, "10 s": 10.0, "60 s": 60.0, "10 min": 600.0}
EVENTS_BETWEEN_LOOKS = 500  # between checks of the clock


class Curve(NamedTuple):
    """A signal [unit] over time [s], both of shape (n,), in a window from `begin` to `end` [s].

    `cursor` is the time shown in the scene [s]; None if that is the end. `note` says what is missing.
    """

    seconds: Floats
    values: Floats
    begin: float
    end: float
    cursor: float | None
    note: str = ""


class Curves(Protocol):
    """Curves of the selected signals; `windows` are the available time spans [s] by name."""

    windows: dict[str, float]

    def want(self, names: Iterable[FieldName]) -> None:
        """Keep only these signals from now on."""

    def curve(self, name: FieldName, window: float, now: int) -> Curve:
        """Return a signal in a window, with `now` [us] shown in the scene."""


class _Ring:
    """The last values of a signal and their times [us]."""

    def __init__(self) -> None:
        self._times, self._values = np.zeros(MOST_LIVE, np.int64), np.zeros(MOST_LIVE)
        self._count = 0

    def add(self, utime: int, value: float) -> None:
        place = self._count % MOST_LIVE
        self._times[place], self._values[place] = utime, value
        self._count += 1

    def since(self, utime: int) -> tuple[Integers, Floats]:
        """Return times and values from a moment on, in order of time."""
        times, values = self._times[: self._count], self._values[: self._count]
        chosen = np.flatnonzero(times >= utime)
        order = chosen[np.argsort(times[chosen], kind="stable")]
        return times[order], values[order]


class LiveCurves:
    """Signals since they were first selected."""

    windows = LIVE_WINDOWS

    def __init__(self) -> None:
        self._rings: dict[str, dict[FieldName, _Ring]] = {}

    def want(self, names: Iterable[FieldName]) -> None:
        """Record only these signals from now on."""
        before, self._rings = self._rings, {}
        for name in _bounded(names):
            known = before.get(name.channel, {}).get(name)
            self._rings.setdefault(name.channel, {})[name] = known or _Ring()

    def take(self, utime: int, channel: str, data: bytes) -> None:
        """Add a message that arrived at `utime` [us]."""
        rings = self._rings.get(channel)
        if rings:
            for name, moment, value in _numbers(rings, utime, Event(0, utime, channel, data)):
                rings[name].add(moment, value)

    def curve(self, name: FieldName, window: float, now: int) -> Curve:
        """Return a signal in the last `window` [s]; 0 s is now."""
        ring = self._rings.get(name.channel, {}).get(name)
        if ring is None:
            return _not_kept(-window, 0.0)
        times, values = ring.since(now - int(MICROSECONDS * window))
        note = "" if len(times) else f"no message on {name.channel} in this window"
        return Curve((times - now) / MICROSECONDS, values, -window, 0.0, None, note)


class LogCurves:
    """Signals from an indexed log; `read` continues reading those selected."""

    windows = LOG_WINDOWS

    def __init__(self, index: LogIndex) -> None:
        self._index = index
        self._rows: dict[FieldName, Rows] = {}
        self._complete: set[FieldName] = set()
        self._reading: Iterator[float] | None = None
        self._read_now: dict[str, dict[FieldName, Rows]] = {}
        self._progress = 0.0

    @property
    def pending(self) -> bool:
        """Whether there is something left to read."""
        return not self._complete.issuperset(self._rows)

    def want(self, names: Iterable[FieldName]) -> None:
        """Keep these signals and no others."""
        self._rows = {name: self._rows.get(name) or Rows(1, MOST_OF_LOG) for name in _bounded(names)}
        self._complete &= self._rows.keys()

    def read(self, seconds: float) -> None:
        """Read on for some time [s]."""
        enough = time.monotonic() + seconds
        while self.pending and time.monotonic() < enough:
            if self._reading is None:
                self._reading = self._pass()
            self._progress = next(self._reading, 1.0)
            if self._progress >= 1.0:
                self._complete |= {name for rows in self._read_now.values() for name in rows} & self._rows.keys()
                self._reading = None

    def curve(self, name: FieldName, window: float, now: int) -> Curve:
        """Return a signal in the whole log, or in the current span of `window` [s]."""
        cursor, length = self._index.seconds(now), self._index.seconds(self._index.end)
        begin = window * (cursor // window) if window else 0.0
        end = begin + window if window else max(length, 0.1)
        if name not in self._rows:
            return _not_kept(begin, end)
        times, (values,) = self._rows[name].all()[0], self._rows[name].all()[1].T
        order = np.argsort(times, kind="stable")
        seconds, values = (times[order] - self._index.begin) / MICROSECONDS, values[order]
        # One more value on each side, so that lines reach the edge.
        first = max(int(np.searchsorted(seconds, begin)) - 1, 0)
        part = slice(first, int(np.searchsorted(seconds, end, side="right")) + 1)
        missing = "" if len(values) else f"no message on {name.channel} in this log"
        note = missing if name in self._complete else f"reading the log, {100 * self._progress:.0f} %"
        return Curve(seconds[part], values[part], begin, end, cursor, note)

    def _pass(self) -> Iterator[float]:
        """Read the log once for all selected signals that are missing; yield the progress [0 to 1]."""
        self._read_now = {}
        for name in self._rows.keys() - self._complete:
            self._rows[name] = rows = Rows(1, MOST_OF_LOG)
            self._read_now.setdefault(name.channel, {})[name] = rows
        length = max(self._index.end - self._index.begin, 1)
        for count, (moment, event) in enumerate(self._index.read(self._index.begin)):
            rows_of = self._read_now.get(event.channel)
            if rows_of:
                for name, at, value in _numbers(rows_of, moment, event):
                    rows_of[name].add(at, (value,))
            if not count % EVENTS_BETWEEN_LOOKS:
                yield min((moment - self._index.begin) / length, 0.99)


def _bounded(names: Iterable[FieldName]) -> list[FieldName]:
    return list(dict.fromkeys(names))[:MOST_SIGNALS]


def _not_kept(begin: float, end: float) -> Curve:
    note = f"Not drawn: the page keeps {MOST_SIGNALS} signals for all visitors together. Remove another one."
    return Curve(np.empty(0), np.empty(0), begin, end, None, note)


def _numbers(names: Iterable[FieldName], moment: int, event: Event) -> Iterator[tuple[FieldName, int, float]]:
    """Yield the values of signals on a message's channel, with its time [us]; empty if it is damaged.

    A message without the robot, such as another part of a world, yields nothing.
    """
    try:
        message = decode(event.channel, event.data).message
    except RejectedMessage:
        return
    at = measured_at(moment, event.utime, message.utime)
    for name in names:
        value = number_in(message, name)
        if not (name.whose and np.isnan(value)):
            yield name, at, value
