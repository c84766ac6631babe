"""What a page shows and how wishes are fulfilled: the live world, or a log that is played."""

from pathlib import Path
from typing import Any, Protocol

from cmr.bus.messages import now_utime
from cmr.recordings.events import EventReader
from cmr.view import words
from cmr.view.intake import Intake
from cmr.view.live import Ear
from cmr.view.log_index import LogIndex
from cmr.view.orders import Orders
from cmr.view.playback import Playback
from cmr.view.replay_panel import ReplayPanel
from cmr.view.robots import REAL, TWIN, VIRTUAL
from cmr.view.state import ViewState
from cmr.view.wishes import FIGURE_EIGHT, JUMP, PAUSE, RELEASE, SPEED, STOP, Wish

SHARE_FOR_INDEX = 0.5  # of the time in which a log is read to the end, while its page is already there
RED, GREEN = "#d62828", "inherit"


class Showing(Protocol):
    """What `cmr-view` runs: `state` is shown, `orders` go to the bus, `panel` makes what a page has besides."""

    orders: Orders

    @property
    def state(self) -> ViewState:
        """What is shown now."""

    def panel(self) -> ReplayPanel | None:
        """Return what a new page has for it."""

    def advance(self, seconds: float) -> None:
        """Let time pass."""

    def fulfil(self, wish: Wish, utime: int) -> None:
        """Do what a visitor wishes, who may; `utime` is the time of day [us]."""

    def head(self) -> str:
        """Return the line at the top of the page, as HTML."""

    def message(self) -> str:
        """Return a sentence for PROCESS_STATUS."""


class LiveShowing:
    """The bus. Raises BusError when it cannot be used."""

    def __init__(self, url: str | None) -> None:
        self.orders = Orders()
        self.state = ViewState()
        self._intake = Intake(self.state)
        self._ear = Ear(url, self._intake)

    def panel(self) -> None:
        """There is nothing besides."""

    def advance(self, _seconds: float) -> None:
        """Take what was said."""
        self._ear.listen()
        self._intake.flush()
        self.state.advance(now_utime())

    def fulfil(self, wish: Wish, utime: int) -> None:
        """Do what a visitor wishes."""
        _stop_or_release(self.orders, wish, utime)
        if wish.what == FIGURE_EIGHT:
            place = self.state.present().place(wish.value)
            if place is not None and not self.orders.stopped:
                self.orders.figure_eight(utime, wish.value, place)

    def head(self) -> str:
        """Return who is there, and whether the emergency stop is engaged."""
        return words.sentence("LIVE · " + crowd(self.state)) + stop_line(self.orders)

    def message(self) -> str:
        """Return who is there."""
        return ""


class LogShowing:
    """The log in a file. Raises OSError."""

    def __init__(self, path: Path) -> None:
        self.orders = Orders()
        self._path = path
        self._playback = Playback(LogIndex(EventReader(path)))

    @property
    def state(self) -> ViewState:
        """What is shown now."""
        return self._playback.state

    def panel(self) -> ReplayPanel:
        """Return slider, speed and pause."""
        return ReplayPanel(self._playback)

    def advance(self, seconds: float) -> None:
        """Play on, and read on."""
        self._playback.index.build(SHARE_FOR_INDEX * seconds)
        self._playback.play(seconds)

    def fulfil(self, wish: Wish, utime: int) -> None:
        """Do what a visitor wishes."""
        _stop_or_release(self.orders, wish, utime)
        acts: dict[str, Any] = {PAUSE: self._pause, SPEED: self._set_speed, JUMP: self._playback.jump}
        if wish.what in acts:
            acts[wish.what](wish.value)

    def head(self) -> str:
        """Return where the log is and who is there."""
        playback = self._playback
        known = "" if playback.index.complete else f" · {100 * playback.index.progress:.0f} % read"
        known += ", not yet what happened before this" if playback.is_guess else ""
        seconds = (playback.position - playback.index.begin) / 1e6
        in_log = f"In the log, the emergency stop is engaged by {self.state.estop.reason}."
        line = words.sentence(f"LOG {self._path.name} · {seconds:.1f} s{known} · {crowd(self.state)}")
        line += words.sentence(self._damage(), RED) if self._damage() else ""
        return line + (words.sentence(in_log, RED) if self.state.estop.engaged else "") + stop_line(self.orders)

    def _damage(self) -> str:
        """Return how much of the log is no intact event, as far as it has been read; empty if all is well."""
        index, reader = self._playback.index, self._playback.index.reader
        if index.complete and not index.places:
            return f"No intact event in {reader.size} bytes. Is it an event log, as lcm-logger writes it?"
        damaged = reader.damaged_bytes
        return f"{damaged} of {reader.size} bytes are damaged; the intact events are shown." if damaged else ""

    def message(self) -> str:
        """Return what is played."""
        return f"Plays {self._path.name}."

    def _pause(self, _value: Any) -> None:
        if self._playback.at_end:
            self._playback.jump(self._playback.index.begin)
            self._playback.paused = False
        else:
            self._playback.paused = not self._playback.paused

    def _set_speed(self, speed: float) -> None:
        self._playback.speed = speed


def crowd(state: ViewState) -> str:
    """Return how many robots there are of each kind."""
    origins = state.present().origin
    kinds = ((REAL, "real"), (VIRTUAL, "virtual"), (TWIN, "twins"))
    return ", ".join(f"{(origins == origin).sum()} {name}" for origin, name in kinds)


def stop_line(orders: Orders) -> str:
    """Return, as HTML, that the emergency stop is engaged, if it is."""
    return words.sentence(f"EMERGENCY STOP engaged by {orders.reason}", RED) if orders.stopped else ""


def _stop_or_release(orders: Orders, wish: Wish, utime: int) -> None:
    if wish.what == STOP:
        orders.stop(utime)
    elif wish.what == RELEASE:
        orders.release(utime)
