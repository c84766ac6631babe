"""Input from a gamepad, from the bytes of the kernel's event devices (struct input_event).

The robot moves only while the dead-man button is held: an upper button at the back, or the trigger of a joystick.
Source: Linux, Documentation/input/event-codes.rst and include/uapi/linux/input.h.
"""

import struct
from collections.abc import Iterator, Mapping
from typing import NamedTuple, Protocol

from cmr.teleop.hands import STILL, STOP, Hands

EVENT = struct.Struct("llHHi")  # time (s, us), type, code, value
EV_SYN, EV_KEY, EV_ABS = 0, 1, 3
SYN_REPORT, SYN_DROPPED = 0, 3
ABS_X, ABS_Y = 0, 1
BTN_TRIGGER, BTN_SOUTH, BTN_EAST, BTN_TL, BTN_TR = 0x120, 0x130, 0x131, 0x136, 0x137
DEAD_MAN = frozenset({BTN_TL, BTN_TR, BTN_TRIGGER})
STOPS = frozenset({BTN_EAST})
CENTRE = 0.12  # dead zone, as a share of the stick's travel
USUAL_RANGE = (-32768, 32767)


class Pad(Protocol):
    """The file of a device. `ranges` are the least and greatest values of its axes, empty while the device is gone."""

    name: str
    ranges: Mapping[int, tuple[int, int]]

    def read(self, now: float) -> bytes | None:
        """Return the bytes received; None while the device is not there."""


class _InputEvent(NamedTuple):
    kind: int
    code: int
    value: int


class Gamepad:
    """The left stick and the buttons of a pad. After it was unplugged, the demand is zero until its button is pressed
    again.
    """

    name = "gamepad"

    def __init__(self, pad: Pad) -> None:
        self._pad = pad
        self._is_there = False
        self._rest = b""
        self._forget()
        self._requests: list[str] = []

    def look(self, now: float) -> None:
        """Process what its device reports."""
        data = self._pad.read(now)
        if data is None:
            self._is_there, self._rest = False, b""
            self._forget()
            return
        self._is_there = True
        for event in self._events(data):
            self._take(event)

    def hands(self, _now: float) -> Hands:
        """Return the position of the stick while the dead-man button is held."""
        if not self._held:
            return STILL
        x, y = (self._share(axis) for axis in (ABS_X, ABS_Y))
        return Hands(-y, -x).bounded()  # the axes go to the right, and towards the hand

    def requests(self) -> list[str]:
        """Return the requests since the last call."""
        requests, self._requests = self._requests, []
        return requests

    def problem(self, _now: float) -> str:
        """Return that the gamepad is missing, or that its button is not held."""
        if not self._is_there:
            return f"the gamepad ({self._pad.name})"
        return "" if self._held else "the dead-man button (an upper button at the back of the gamepad) to be held"

    def _events(self, data: bytes) -> Iterator[_InputEvent]:
        data = self._rest + data
        whole = len(data) - len(data) % EVENT.size
        self._rest = data[whole:]
        for _seconds, _microseconds, kind, code, value in EVENT.iter_unpack(data[:whole]):
            yield _InputEvent(kind, code, value)

    def _take(self, event: _InputEvent) -> None:
        # the kernel dropped events: the state of the buttons is unknown
        if event.kind == EV_SYN and event.code == SYN_DROPPED:
            self._forget()
            self._incomplete = True
        elif event.kind == EV_SYN and event.code == SYN_REPORT:
            self._incomplete = False
        elif self._incomplete:
            pass
        elif event.kind == EV_ABS and event.code in (ABS_X, ABS_Y):
            self._axes[event.code] = event.value
        elif event.kind == EV_KEY and event.code in DEAD_MAN:
            (self._held.add if event.value else self._held.discard)(event.code)
        elif event.kind == EV_KEY and event.code in STOPS and event.value == 1:
            self._requests.append(STOP)

    def _forget(self) -> None:
        self._axes: dict[int, int] = {}
        self._held: set[int] = set()
        self._incomplete = False

    def _share(self, axis: int) -> float:
        """Return the deflection of an axis, -1 to 1; an axis that has not moved yet is centred."""
        if axis not in self._axes:
            return 0.0
        low, high = self._pad.ranges.get(axis, USUAL_RANGE)
        share = (2.0 * self._axes[axis] - low - high) / max(high - low, 1)
        beyond = max(abs(share) - CENTRE, 0.0) / (1.0 - CENTRE)
        return min(beyond, 1.0) * (1.0 if share > 0.0 else -1.0)
