"""The content of a page and its reactions to requests: the live world, or a log being played."""

from pathlib import Path
from typing import Protocol

from cmr.bus.messages import now_utime
from cmr.recordings.events import EventReader
from cmr.view import words
from cmr.view.curves import Curves, LiveCurves, LogCurves
from cmr.view.data.intake import Intake
from cmr.view.data.live import Subscriber
from cmr.view.data.log_index import LogIndex
from cmr.view.data.playback import Playback
from cmr.view.data.robots import REAL, TWIN, VIRTUAL
from cmr.view.data.signals import Source, sources
from cmr.view.data.state import ViewState
from cmr.view.orders import Orders
from cmr.view.replay_panel import ReplayPanel
from cmr.view.requests import FIGURE_EIGHT, JUMP, PAUSE, RELEASE, SPEED, STOP, Request

SHARE_FOR_INDEX = 0.5  # of the time, for indexing a log while its page is already shown
RED, GREEN = "#d62828", "inherit"


class Showing(Protocol):
    """The content of `cmr-view`: `state` is shown, `orders` go to the bus, `panel` makes additional controls.

    `name` is its name for visitors.
    """

    orders: Orders
    name: str

    @property
    def curves(self) -> Curves:
        """The signals plotted by visitors."""

    @property
    def state(self) -> ViewState:
        """The current state."""

    def panel(self) -> ReplayPanel | None:
        """Return the additional controls of a new page."""

    def sources(self) -> list[Source]:
        """Return the sources of signals."""

    def advance(self, seconds: float) -> None:
        """Let time pass."""

    def fulfil(self, request: Request, utime: int) -> None:
        """Fulfil a permitted request; `utime` is the time of day [us]."""

    def head(self) -> str:
        """Return the line at the top of the page, as HTML."""

    def message(self) -> str:
        """Return a sentence for PROCESS_STATUS."""


class LiveShowing:
    """The bus. Raises BusError when it cannot be used."""

    name = "the live world"

    def __init__(self, url: str | None) -> None:
        self.orders = Orders()
        self.state = ViewState()
        self.curves = LiveCurves()
        self._intake = Intake(self.state, self.curves.take)
        self._ear = Subscriber(url, self._intake)

    def panel(self) -> None:
        """Return no additional controls."""

    def sources(self) -> list[Source]:
        """Return the active channels, without those of robots that have left."""
        return sources(self.state.heard_channels(), self.state.present(), self.state.array_lengths())

    def advance(self, _seconds: float) -> None:
        """Process received messages."""
        self._ear.listen()
        self._intake.flush()
        self.state.advance(now_utime())

    def fulfil(self, request: Request, utime: int) -> None:
        """Fulfil a request."""
        _stop_or_release(self.orders, request, utime)
        if request.what == FIGURE_EIGHT:
            place = self.state.present().fresh().place(request.value)
            if place is not None and not self.orders.must_stand(request.value):
                self.orders.figure_eight(utime, request.value, place)

    def head(self) -> str:
        """Return which robots are there, and whether the emergency stop is engaged."""
        return words.sentence("LIVE · " + crowd(self.state)) + stop_line(self.orders)

    def message(self) -> str:
        """Return which robots are there."""
        return ""


class LogShowing:
    """The log in a file, with a `share` of the time spent on indexing it. Raises OSError."""

    def __init__(self, path: Path, name: str = "", share: float = SHARE_FOR_INDEX) -> None:
        self.orders = Orders()
        self.name = name or path.name
        self._share = share
        self._playback = Playback(LogIndex(EventReader(path)))
        self.curves = LogCurves(self._playback.index)

    @property
    def state(self) -> ViewState:
        """The current state."""
        return self._playback.state

    def panel(self) -> ReplayPanel:
        """Return slider, speed and pause."""
        return ReplayPanel(self._playback)

    def sources(self) -> list[Source]:
        """Return the log's channels so far, and the robots present now."""
        return sources(self._playback.index.places, self.state.present(), self.state.array_lengths())

    def advance(self, seconds: float) -> None:
        """Play on, and continue indexing."""
        index = self._playback.index
        reading = self._share * seconds / (1 + (self.curves.pending and not index.complete))
        index.build(reading)
        self.curves.read(reading)
        self._playback.play(seconds)

    def fulfil(self, request: Request, utime: int) -> None:
        """Fulfil a request."""
        _stop_or_release(self.orders, request, utime)
        if request.what == PAUSE:
            self._pause()
        elif request.what == SPEED:
            self._playback.speed = request.value
        elif request.what == JUMP:
            self._playback.jump(request.value)

    def head(self) -> str:
        """Return the log's position and its robots."""
        playback = self._playback
        known = "" if playback.index.complete else f" · {100 * playback.index.progress:.0f} % read"
        known += ", not yet what happened before this" if playback.is_guess else ""
        seconds = playback.index.seconds(playback.position)
        in_log = f"In the log, the emergency stop is engaged by {self.state.estop.reason}."
        lines = [words.sentence(f"LOG {self.name} · {seconds:.1f} s{known} · {crowd(self.state)}")]
        lines += [words.sentence(self._damage(), RED)] if self._damage() else []
        lines += [words.sentence(in_log, RED)] if self.state.estop.engaged else []
        return "".join(lines) + stop_line(self.orders)

    def _damage(self) -> str:
        """Return how much of the log is damaged, as far as it has been read; empty if nothing is."""
        index, reader = self._playback.index, self._playback.index.reader
        if index.complete and not index.places:
            return f"No intact event in {reader.size} bytes. Is it an event log, as lcm-logger writes it?"
        damaged = reader.damaged_bytes
        return f"{damaged} of {reader.size} bytes are damaged; the intact events are shown." if damaged else ""

    def message(self) -> str:
        """Return what is being played."""
        return f"Plays {self.name}."

    def _pause(self) -> None:
        if self._playback.at_end:
            self._playback.jump(self._playback.index.begin)
            self._playback.paused = False
        else:
            self._playback.paused = not self._playback.paused


def crowd(state: ViewState) -> str:
    """Return the number of robots of each kind, and of silent ones."""
    robots = state.present()
    real, virtual, twins = ((robots.origin == origin).sum() for origin in (REAL, VIRTUAL, TWIN))
    counts = f"{real} real, {virtual} virtual, {twins} {'twin' if twins == 1 else 'twins'}"
    return f"{counts} ({robots.silent.sum()} silent)" if robots.silent.any() else counts


def stop_line(orders: Orders) -> str:
    """Return HTML on an engaged emergency stop, and on robots held by drivers, if any."""
    engaged = words.sentence(f"EMERGENCY STOP engaged by {orders.reason}", RED) if orders.stopped else ""
    latched = f"EMERGENCY STOP in force until it is reset, engaged by {orders.latched_reason}"
    return engaged + (words.sentence(latched, RED) if orders.latched_reason else "")


def _stop_or_release(orders: Orders, request: Request, utime: int) -> None:
    if request.what == STOP:
        orders.stop(utime)
    elif request.what == RELEASE:
        orders.release()
