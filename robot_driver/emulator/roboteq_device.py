"""The device's side of Roboteq's serial commands. Motor and encoder 1 are the left side, 2 the right side.

Source: Roboteq "Advanced Digital Motor Controller User Manual", serial commands. A line ends with a carriage return
or "_". Every character is echoed unless that is switched off. Actions (!) and settings (^) are answered with "+",
queries (? and ~) with NAME=value:value, and what is not understood with "-".
"""

import math
from collections.abc import Callable

from robot_driver.emulator.device import Transmission, byte_time
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.settings import Settings

ENDS = b"\r_"
END, DONE, REFUSED = "\r", "+", "-"
LONGEST_LINE = 64  # bytes
FULL_DUTY = 1000
IDENTITY = "Roboteq v1.6 SDC2160 05/01/2016"
EMERGENCY_STOP = 0x10  # bit of the fault flags


class RoboteqDevice:
    """A Roboteq with two channels in open loop that drives `plant`.

    `duty` is what the motors get, in steps of 0.001. `faults` and `motor_flags` are the words of ?FF and ?FM. `actions`
    are the lines that fed the watchdog, `saves` counts commands that write to the flash.
    """

    def __init__(self, settings: Settings, plant: Plant) -> None:
        self.byte_time = byte_time(settings.roboteq.baud)
        self.duty = [0, 0]
        self.faults = 0
        self.motor_flags = [0, 0]
        self.actions: list[str] = []
        self.saves = 0
        self._plant = plant
        self._settings = settings
        self._encoder_zero = [0, 0]
        self._actions: dict[str, Callable[..., None]] = {
            "G": self._drive_one,
            "M": self._drive_both,
            "EX": self._stop_for_emergency,
            "MG": self._release,
            "MS": lambda channel: self._drive_one(channel, 0),
            "C": self._set_count,
            "EES": self._save,
        }
        self._readings = self._table_of_readings()
        self.switch_on()

    def switch_on(self) -> None:
        """Begin again with what is kept in the flash, as after power-off."""
        self._wanted = [0, 0]  # duty to go on with at the next action after the watchdog has stopped the motors
        self._configuration = {
            "RWD": [self._settings.roboteq.watchdog],
            "ECHOF": [0 if self._settings.roboteq.echo else 1],
            "MMOD": [0, 0],
            "MXMD": [0],
            "CLIN": [0, 0],
        }
        self._line = b""
        self._last_action = -math.inf
        self._encoder_zero = list(self._counts())
        self._apply(self._wanted)

    @property
    def watchdog(self) -> int:
        """How long the motors go on without an action (ms); 0: for ever."""
        return self._configuration["RWD"][0]

    @property
    def wake_time(self) -> float:
        """When the motors stop unless an action comes; infinity while they rest or have no watchdog."""
        return self._last_action + self.watchdog / 1000 if self.watchdog and any(self.duty) else math.inf

    def wake(self, time: float) -> list[Transmission]:
        """Stop the motors if no action has come for too long; they go on as before at the next one."""
        if time >= self.wake_time:
            self._apply([0, 0])
        return []

    def receive(self, data: bytes, time: float) -> list[Transmission]:
        """Take bytes of which the last has arrived at `time`; echo them, and answer every line that is complete."""
        sent: list[Transmission] = []
        while data:
            if self._configuration["ECHOF"][0]:
                taken = _up_to_end(data)
                reply = self._take(taken, time)
            else:
                taken = data[:1]
                reply = taken + self._take(taken, time)
            data = data[len(taken) :]
            if reply:
                time += len(reply) * self.byte_time
                sent.append(Transmission(time, reply))
        return sent

    def _take(self, data: bytes, time: float) -> bytes:
        """Add bytes to the line, the last of which may end it; return the answer if it does, else nothing."""
        if data[-1] not in ENDS:
            self._line = (self._line + data)[-LONGEST_LINE:]
            return b""
        self._line = (self._line + data[:-1])[-LONGEST_LINE:]
        line, self._line = self._line.decode("ascii", "replace").strip(), b""
        return (self._answer(line, time) + END).encode("ascii") if line else b""

    def _answer(self, line: str, time: float) -> str:
        kind, (name, *texts) = line[0], line[1:].split() or [""]
        try:
            values = [int(text) for text in texts]
            if kind == "!":
                return self._act(line, name, values, time)
            if kind == "?":
                return f"{name}={self._reading(name, *values)}"
            if kind == "~":
                return f"{name}={_colons(_of_channel(self._configuration[name], *values))}"
            return self._configure(kind, name, values)
        except (KeyError, ValueError, TypeError, IndexError):
            return REFUSED

    def _act(self, line: str, name: str, values: list[int], time: float) -> str:
        self._actions[name](*values)
        self._apply(self._wanted)  # any action has a channel that it does not set go on as before the watchdog
        self._last_action = time
        self.actions.append(line)
        return DONE

    def _configure(self, kind: str, name: str, values: list[int]) -> str:
        if kind == "%":
            self._save()
            return DONE
        if kind != "^" or not values:
            return REFUSED
        channel, value = (values[0] - 1, values[1]) if len(self._configuration[name]) > 1 else (0, values[0])
        if name == "RWD" and not 0 <= value <= 65000:
            return REFUSED
        if not (name == "RWD" and self._settings.roboteq.ignores_watchdog):
            self._configuration[name][channel] = value
        return DONE

    def _table_of_readings(self) -> dict[str, Callable[[], list[int]]]:
        """Return what each query reads, one value for each channel or whatever else it reports."""
        degrees = round(self._settings.electrics.temperature)
        return {
            "A": self._currents,
            "C": self._encoders,
            "FF": lambda: [self.faults],
            "FM": lambda: self.motor_flags,
            "M": lambda: self._wanted,
            "P": lambda: self.duty,
            "T": lambda: [degrees, degrees, degrees],
            "V": lambda: [135, round(self._plant.battery_voltage() * 10), 4730],
        }

    def _reading(self, name: str, *channel: int) -> str:
        return IDENTITY if name == "FID" else _colons(_of_channel(self._readings[name](), *channel))

    def _drive_one(self, channel: int, value: int) -> None:
        if channel not in (1, 2):
            raise ValueError
        wanted = list(self._wanted)
        wanted[channel - 1] = value
        self._drive_both(*wanted)

    def _drive_both(self, first: int, second: int) -> None:
        self._wanted = [max(-FULL_DUTY, min(FULL_DUTY, value)) for value in (first, second)]

    def _apply(self, duty: list[int]) -> None:
        self.duty = [0, 0] if self.faults & EMERGENCY_STOP else list(duty)
        self._plant.command(self.duty[0] / FULL_DUTY, self.duty[1] / FULL_DUTY)

    def _stop_for_emergency(self) -> None:
        self.faults |= EMERGENCY_STOP
        self._drive_both(0, 0)

    def _release(self) -> None:
        self.faults &= ~EMERGENCY_STOP

    def _set_count(self, channel: int, value: int) -> None:
        self._encoder_zero[channel - 1] = self._counts()[channel - 1] - value

    def _save(self) -> None:
        self.saves += 1

    def _counts(self) -> tuple[int, int]:
        left, right = self._plant.encoder_counts()
        return math.floor(left), math.floor(right)

    def _encoders(self) -> list[int]:
        """Return both registers: counts since the start, as signed numbers of 32 bits."""
        since = [count - zero for count, zero in zip(self._counts(), self._encoder_zero, strict=True)]
        return [(count + 2**31) % 2**32 - 2**31 for count in since]

    def _currents(self) -> list[int]:
        """Return both currents in units of 0.1 A."""
        return [round(current * 10.0) for current in self._plant.motor_currents()]


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
