"""The panel that plays a log: position, events, speed and pause."""

import math
import re
import time
from collections.abc import Callable, Sequence

import viser

from cmr.bus.messages import MICROSECONDS
from cmr.view.data.log_index import Mark
from cmr.view.data.playback import Playback
from cmr.view.inputs import write
from cmr.view.look import GO_TO, time_bar
from cmr.view.requests import JUMP, PAUSE, SPEED

SPEEDS = ("0.1", "0.5", "1", "2", "5", "10", "20", "50")
STEP = 0.1  # s
STEP_BY_KEY = 5.0  # s
HANDS_OFF = 2.0  # s after a visitor used the slider or its box, during which it is not updated
TYPED = 0.7  # s after the last keystroke until a time counts as complete
MARKS_APART = 3.0  # s between updates of marks, which recreate the slider
MOST_ON_SLIDER = 12  # marks; more would overlap
LABELS_APART = 0.3  # of the slider's length; labels of closer marks would overlap
WORTH = ("stop", "calibrated", "failed", "diagnosis", "released", "parameters")  # priority of labels, first to last
TIME_PART = re.compile(r"[0-9]{1,9}(\.[0-9]*)?")
CHOOSE = "jump to an event ..."

Asking = Callable[..., None]


class ReplayPanel:
    """Shows the position of a playback, and passes on requests to change it."""

    def __init__(self, playback: Playback) -> None:
        self._playback = playback
        self._marks = 0
        self._marks_due = 0.0
        self._touched = self._typed = 0.0
        self._wanted: float | None = None  # s; the time being typed

    def add(self, gui: viser.GuiApi, ask: Asking) -> None:
        """Add it to a page; `ask(what, value)` passes on requests."""
        self._gui, self._ask = gui, ask
        self._bar = gui.add_html("")
        self._folder = gui.add_folder("replay")
        with self._folder:
            self._slider = self._new_slider(gui, ())
            # This box is never written to, unlike the one at the slider, which shows the position.
            self._time = gui.add_text(GO_TO, "", hint="a time: seconds, or minutes:seconds")
            self._pause = gui.add_button("pause")
            self._speed = gui.add_dropdown("speed", SPEEDS, initial_value="1")
            self._events = gui.add_dropdown("events", (CHOOSE,), initial_value=CHOOSE)
        self._time.on_update(self._type)
        self._pause.on_click(lambda _event: ask(PAUSE))
        self._speed.on_update(self._change_speed)
        self._events.on_update(self._choose_event)
        self._add_keys(gui)

    def _add_keys(self, gui: viser.GuiApi) -> None:
        """Let the space bar pause and play, and arrows jump by STEP_BY_KEY."""
        gui.add_command("pause or play", hotkey="space").on_trigger(lambda _event: self._ask(PAUSE))
        step = f"{STEP_BY_KEY:g} s"
        gui.add_command(f"back {step}", hotkey="arrowleft").on_trigger(self._stepping(-STEP_BY_KEY))
        gui.add_command(f"on {step}", hotkey="arrowright").on_trigger(self._stepping(STEP_BY_KEY))

    def _stepping(self, seconds: float) -> Callable[[object], None]:
        return lambda _event: self._ask(JUMP, self._playback.position + int(seconds * MICROSECONDS))

    def show(self) -> None:
        """Update it."""
        playback = self._playback
        if self._wanted is not None and time.monotonic() - self._typed >= TYPED:
            self._ask(JUMP, playback.index.moment(self._wanted))
            self._wanted = None
        self._pause.label = "play again" if playback.at_end else "play" if playback.paused else "pause"
        end = self._end()
        if self._slider.max != end:
            self._slider.max = end
        marks = [(playback.index.seconds(mark.utime), mark) for mark in playback.index.marks]
        self._bar.content = time_bar(min(playback.index.seconds(playback.position), end), end, marks)
        if time.monotonic() - self._touched <= HANDS_OFF:
            return
        write(self._slider, round(min(playback.index.seconds(playback.position), end), 1))
        write(self._speed, f"{playback.speed:g}")
        if len(playback.index.marks) != self._marks and time.monotonic() >= self._marks_due:
            self._marks_due = time.monotonic() + MARKS_APART
            self._show_marks(playback.index.marks)

    def _show_marks(self, marks: Sequence[Mark]) -> None:
        self._marks = len(marks)
        step = -(-len(marks) // MOST_ON_SLIDER)
        self._slider.remove()
        with self._folder:  # viser cannot change the marks of an existing slider
            self._slider = self._new_slider(self._gui, marks[::step])
        self._events.options = (CHOOSE, *(self._name(number, mark) for number, mark in enumerate(marks)))

    def _new_slider(self, gui: viser.GuiApi, marks: Sequence[Mark]) -> viser.GuiSliderHandle[float]:
        end, seconds = self._end(), self._playback.index.seconds
        words = labelled([(seconds(mark.utime), mark.word) for mark in marks], end)
        now = round(min(seconds(self._playback.position), end), 1)
        slider = gui.add_slider("time [s]", 0.0, end, STEP, now, marks=words or None, order=0.0)
        slider.on_update(self._slide)
        return slider

    def _name(self, number: int, mark: Mark) -> str:
        minutes, seconds = divmod(self._playback.index.seconds(mark.utime), 60.0)
        return f"{number + 1}. {minutes:.0f}:{seconds:04.1f} {mark.sentence[:80]}"

    def _slide(self, event: viser.GuiEvent[viser.GuiSliderHandle[float]]) -> None:
        if event.client_id is not None:
            self._touched = time.monotonic()
            self._ask(JUMP, self._playback.index.moment(self._slider.value))

    def _type(self, event: viser.GuiEvent[viser.GuiTextHandle]) -> None:
        if event.client_id is not None:
            self._typed, self._wanted = time.monotonic(), seconds_of(self._time.value)

    def _change_speed(self, event: viser.GuiEvent[viser.GuiDropdownHandle[str]]) -> None:
        if event.client_id is not None:
            self._ask(SPEED, float(self._speed.value))

    def _choose_event(self, event: viser.GuiEvent[viser.GuiDropdownHandle[str]]) -> None:
        if event.client_id is None or self._events.value == CHOOSE:
            return
        number = int(self._events.value.split(".", 1)[0]) - 1
        write(self._events, CHOOSE)
        self._ask(JUMP, self._playback.index.marks[number].utime)

    def _end(self) -> float:
        """Return the end of the slider [s], in whole steps."""
        index = self._playback.index
        return round(math.ceil(max(index.seconds(index.end), STEP) / STEP) * STEP, 1)


def seconds_of(text: str) -> float | None:
    """Parse a time [s]: 90, 1:30 or 0:01:30.5; None if it is invalid."""
    seconds = 0.0
    for part in text.strip().split(":"):
        if TIME_PART.fullmatch(part) is None:
            return None
        seconds = 60.0 * seconds + float(part)
    return seconds


def labelled(marks: Sequence[tuple[float, str]], length: float) -> tuple[float | tuple[float, str], ...]:
    """Return marks on a slider of this length, with labels where they fit, by priority."""
    chosen: list[tuple[float, str]] = []
    for mark in sorted(marks, key=lambda mark: WORTH.index(mark[1])):
        if all(abs(mark[0] - other) >= LABELS_APART * length for other, _ in chosen):
            chosen.append(mark)
    return tuple(mark if mark in chosen else mark[0] for mark in marks)
