"""The device's side of Roboteq's serial commands: lines, their echo and their answers.

Source: Roboteq "Advanced Digital Motor Controller User Manual", serial commands. A line ends with a carriage return or
"_". Every character is echoed unless that is switched off; those below a space have no effect. Names may be in small
letters. Actions (!) and settings (^) are answered with "+", queries (? and ~) with NAME=value:value, and unknown
commands with "-". Real devices also accept what the client PyRoboteq, which works with them, sends: numbers in square
brackets, empty brackets, and a "+" at the end. The commands are in `boards.roboteq_commands`.
"""

import math
import re

from robot_driver.emulator.boards.roboteq import RoboteqBoard
from robot_driver.emulator.boards.roboteq_commands import ACTIONS, IDENTITY, QUERIES, SETTINGS, Setting
from robot_driver.emulator.device import NotUnderstood, Transmission, byte_time
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.settings import Settings

ENDS = b"\r_"
END, DONE, REFUSED = "\r", "+", "-"
LONGEST_LINE = 64  # bytes
WITHOUT_EFFECT = re.compile(r"[\x00-\x1f]")
NUMBER = re.compile(r"\[?([+-]?[0-9]+)?[\]+]*")  # also none in brackets, or nothing but the plus sign


class RoboteqDevice(RoboteqBoard):
    """A Roboteq with two channels that drives `plant`.

    `actions` are the lines that fed the watchdog; `not_understood` counts the lines that were refused.
    """

    def __init__(self, settings: Settings, plant: Plant) -> None:
        self.byte_time = byte_time(settings.roboteq.baud)
        self.actions: list[str] = []
        self.not_understood = NotUnderstood()
        super().__init__(settings, plant)

    def switch_on(self) -> None:
        """Restart from the flash, as after power-off."""
        self._line = b""
        self._last_action = -math.inf
        super().switch_on()

    @property
    def watchdog(self) -> int:
        """Time for which the motors run without an action (ms); 0: unlimited."""
        return self.configuration["RWD"][0]

    @property
    def wake_time(self) -> float:
        """When a loop is to be stepped, or the motors stop unless an action comes, whichever is first."""
        return min(self.loop_due, self._deadline())

    def wake(self, time: float) -> list[Transmission]:
        """Stop the motors if no action has arrived for too long; they resume at the next one."""
        self.time = time
        if time >= self._deadline():
            self.stop()
        self.go_on()
        return []

    def receive(self, data: bytes, time: float) -> list[Transmission]:
        """Process bytes, the last of which arrived at `time`; echo them, and answer every line that is complete."""
        self.time = time
        sent: list[Transmission] = []
        while data:
            if self.configuration["ECHOF"][0]:
                taken = _up_to_end(data)
                reply = self._take(taken)
            else:
                taken = data[:1]
                reply = taken + self._take(taken)
            data = data[len(taken) :]
            if reply:
                time += len(reply) * self.byte_time
                sent.append(Transmission(time, reply))
        return sent

    def _deadline(self) -> float:
        """Return when the motors stop unless an action comes; infinity while they rest or have no watchdog."""
        return self._last_action + self.watchdog / 1000 if self.watchdog and self.drives else math.inf

    def _take(self, data: bytes) -> bytes:
        """Add bytes to the line, the last of which may end it; return the answer if it does, else no bytes."""
        if data[-1] not in ENDS:
            self._line = (self._line + data)[-LONGEST_LINE:]
            return b""
        self._line = (self._line + data[:-1])[-LONGEST_LINE:]
        line, self._line = WITHOUT_EFFECT.sub("", self._line.decode("ascii", "replace")).strip(), b""
        return (self._answer(line) + END).encode("ascii") if line else b""

    def _answer(self, line: str) -> str:
        kind, (name, *words) = line[0], line[1:].upper().split() or [""]
        try:
            values = _numbers(words)
            if kind == "!":
                return self._act(line, name, values)
            if kind == "?":
                return f"{name}={self._reading(name, *values)}"
            if kind == "~":
                return f"{name}={_colons(_of_channel(self.configuration[name], *values))}"
            return self._configure(kind, name, values)
        except (KeyError, ValueError, TypeError, IndexError):
            self.not_understood.note(f"{kind}{name}")
            return REFUSED

    def _act(self, line: str, name: str, values: list[int]) -> str:
        ACTIONS[name].do(self, *values)
        self._apply(self._wanted)  # after a watchdog stop, an action also resumes a channel that it does not set
        self._last_action = self.time
        self.actions.append(line)
        return DONE

    def _configure(self, kind: str, name: str, values: list[int]) -> str:
        if kind == "%" and name == "EESAV":
            self.save()
            return DONE
        if kind != "^":
            raise ValueError
        setting: Setting = SETTINGS[name]
        channel, value = (values[0], values[1]) if setting.is_of_channel else (1, values[0])
        if value not in setting.values or not 1 <= channel <= len(self.configuration[name]):
            raise ValueError
        if not (name == "RWD" and self.settings.roboteq.ignores_watchdog):
            self.configuration[name][channel - 1] = value
        return DONE

    def _reading(self, name: str, *channel: int) -> str:
        return IDENTITY if name == "FID" else _colons(_of_channel(QUERIES[name].read(self), *channel))


def _numbers(words: list[str]) -> list[int]:
    """Return the numbers of a command; ValueError if there is anything else."""
    matches = [NUMBER.fullmatch(word) for word in words]
    if None in matches:
        raise ValueError
    return [int(match[1]) for match in matches if match is not None and match[1]]


def _up_to_end(data: bytes) -> bytes:
    """Return the first bytes, up to the first that ends a line."""
    for place, byte in enumerate(data):
        if byte in ENDS:
            return data[: place + 1]
    return data


def _of_channel(values: list[int], channel: int = 0) -> list[int]:
    """Return the value of one channel, counted from 1; of all for 0."""
    if not 0 <= channel <= len(values):
        raise ValueError
    return [values[channel - 1]] if channel else values


def _colons(values: list[int]) -> str:
    return ":".join(map(str, values))
