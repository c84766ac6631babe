"""The state of an emulated Roboteq: two channels with their loops, encoders, configuration.

Motor and encoder 1 are the left side, 2 the right side. The meaning of a motor's command depends on `^MMOD`: in open
loop a power, in closed-loop speed (1, and 6, in which the position is followed as well) a share of the speed `^MXRPM`.
"""

import math

from robot_driver.emulator.boards.motor_channel import LOOP_PERIOD, Gains, MotorChannel, Rates
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.settings import Settings

FULL_DUTY = 1000
EMERGENCY_STOP = 0x10  # bit of the fault flags
CHANNELS = (1, 2)
OPEN_LOOP, CLOSED_LOOP_SPEED, CLOSED_LOOP_SPEED_POSITION = 0, 1, 6  # of ^MMOD
TENTH = 0.1  # of ^KP, ^KI and ^KD, and in rpm/s of ^MAC and ^MDEC
PERCENT = 0.01  # of ^MXPF and ^MXPR
MINUTE = 60.0  # s
COUNTS_A_PULSE = 4
TURN = 2.0 * math.pi


class RoboteqBoard:
    """The board; it drives `plant`. `time` (s) is now.

    `faults` and `motor_flags` are the words of ?FF and ?FM, `saves` counts commands that write to the flash,
    `configuration` are all settings by name, with a value for each channel.
    """

    def __init__(self, settings: Settings, plant: Plant) -> None:
        self.settings = settings
        self.plant = plant
        self.time = 0.0
        self.faults = 0
        self.motor_flags = [0, 0]
        self.saves = 0
        self.switch_on()

    def switch_on(self) -> None:
        """Restart from the flash."""
        self.loop_due = math.inf
        self.configuration = default_configuration(self.settings)
        self._wanted: list[float] = [0, 0]  # resumed at the next action after the watchdog; 1000 is full
        self._motors = (MotorChannel(), MotorChannel())
        self._encoder_zero = list(self.counts())
        self._asked_before = [0, 0]  # counts at the last ?CR
        self._apply(self._wanted)

    @property
    def duty(self) -> list[int]:
        """The duties applied to the motors, in steps of 0.001."""
        return [round(FULL_DUTY * duty) for duty in self._limited()]

    @property
    def drives(self) -> bool:
        """Whether a motor turns, or is commanded to."""
        return any(motor.drives for motor in self._motors)

    @property
    def wanted(self) -> list[int]:
        """The commands of the channels, 1000 for full."""
        return [round(value) for value in self._wanted]

    def stop(self) -> None:
        """Stop the motors at once, until the next action."""
        for motor in self._motors:
            motor.drive(0.0)
        self._step(0.0)

    def go_on(self) -> None:
        """Step the loops that are due by now."""
        while self.loop_due <= self.time:
            self.loop_due += LOOP_PERIOD
            self._step(LOOP_PERIOD)

    def want(self, channel: int, value: float) -> None:
        """Command a channel, -1000 to 1000; larger values are clipped."""
        self._wanted[_place(channel)] = max(-FULL_DUTY, min(FULL_DUTY, value))

    def want_both(self, first: int, second: int) -> None:
        """Command both channels."""
        self.want(1, first)
        self.want(2, second)

    def want_rpm(self, channel: int, speed: int) -> None:
        """Command a channel's speed (rpm); in open loop it is converted to a share of the power."""
        self.want(channel, FULL_DUTY * speed / self.configuration["MXRPM"][_place(channel)])

    def set_ramp(self, name: str, channel: int, value: int) -> None:
        """Set a ramp of a channel, unless one of its ramps was configured away."""
        place = _place(channel)
        if value < 0:
            raise ValueError
        if self.configuration["MAC"][place] and self.configuration["MDEC"][place]:
            self.configuration[name][place] = value

    def stop_for_emergency(self) -> None:
        """Stop until it is released."""
        self.faults |= EMERGENCY_STOP
        self.want_both(0, 0)

    def release(self) -> None:
        """Let the motors turn again."""
        self.faults &= ~EMERGENCY_STOP

    def set_count(self, channel: int, value: int) -> None:
        """Set an encoder's count."""
        place = _place(channel)
        self._encoder_zero[place] = self.counts()[place] - value
        self._asked_before[place] = value

    def save(self) -> None:
        """Write to the flash."""
        self.saves += 1

    def counts(self) -> tuple[int, int]:
        """Return the counts of both encoders since the robot was built."""
        left, right = self.plant.encoder_counts()
        return math.floor(left), math.floor(right)

    def encoders(self) -> list[int]:
        """Return both registers: counts since the start, as signed numbers of 32 bits."""
        return [_signed(count - zero) for count, zero in zip(self.counts(), self._encoder_zero, strict=True)]

    def encoders_since_asked(self) -> list[int]:
        """Return the counts of both encoders since the last such query."""
        now, before = self.encoders(), self._asked_before
        self._asked_before = now
        return [_signed(new - old) for new, old in zip(now, before, strict=True)]

    def speeds(self) -> list[float]:
        """Return both speeds in rpm."""
        pulses = self.configuration["EPPR"]
        speeds = self.plant.encoder_speeds()
        return [MINUTE * speed / (COUNTS_A_PULSE * pulse) for speed, pulse in zip(speeds, pulses, strict=True)]

    def relative_speeds(self) -> list[int]:
        """Return both speeds, 1000 for the largest."""
        both = zip(self.speeds(), self.configuration["MXRPM"], strict=True)
        return [round(FULL_DUTY * speed / largest) for speed, largest in both]

    def currents(self) -> list[int]:
        """Return both currents through the motors in units of 0.1 A."""
        return [round(current * 10.0) for current in self.plant.motor_currents()]

    def battery_currents(self) -> list[int]:
        """Return the currents that both channels draw from the battery in units of 0.1 A."""
        both = zip(self.plant.motor_currents(), self._limited(), strict=True)
        return [round(current * duty * 10.0) for current, duty in both]

    def _apply(self, wanted: list[float]) -> None:
        """Apply these commands to the channels; nothing while the emergency stop is engaged."""
        if self.faults & EMERGENCY_STOP:
            self.stop()
            return
        measured = self.plant.encoder_speeds()
        for place, (motor, value) in enumerate(zip(self._motors, wanted, strict=True)):
            share, full = value / FULL_DUTY, self._full_speed(place)
            up, down = (self._ramp(name, place) for name in ("MAC", "MDEC"))
            if self.configuration["MMOD"][place] == OPEN_LOOP:
                motor.drive(share, Rates(up, down))
            else:
                motor.follow(share * full, measured[place], Rates(up * full, down * full))
        self._step(0.0)

    def _step(self, seconds: float) -> None:
        """Step channels that are busy, and apply their duties to the motors."""
        measured = self.plant.encoder_speeds()
        for place, motor in enumerate(self._motors):
            if motor.is_busy:
                motor.step(measured[place], seconds, self._gains(place))
        self.plant.command(*self._limited())
        if not any(motor.is_busy for motor in self._motors):
            self.loop_due = math.inf
        elif math.isinf(self.loop_due):
            self.loop_due = self.time + LOOP_PERIOD

    def _limited(self) -> list[float]:
        """Return the duties within the largest power either way."""
        both = zip(self._motors, self.configuration["MXPR"], self.configuration["MXPF"], strict=True)
        return [max(-PERCENT * backward, min(PERCENT * forward, motor.duty)) for motor, backward, forward in both]

    def _gains(self, place: int) -> Gains:
        p, i, d = (TENTH * self.configuration[name][place] for name in ("KP", "KI", "KD"))
        return Gains(p, i, d, self._full_speed(place))

    def _full_speed(self, place: int) -> float:
        """Return the largest speed (counts/s)."""
        return self.configuration["MXRPM"][place] * self.configuration["EPPR"][place] * COUNTS_A_PULSE / MINUTE

    def _ramp(self, name: str, place: int) -> float:
        """Return the rate of change of a channel (1/s), as a share of its full range; infinity for none."""
        rate = self.configuration[name][place]
        return TENTH * rate / self.configuration["MXRPM"][place] if rate else math.inf


def default_configuration(settings: Settings) -> dict[str, list[int]]:
    """Return all settings of a robot that was set up, without ramps."""
    own, robot, loop = settings.roboteq, settings.robot, settings.speed_loop
    of_channel = {
        **{"MMOD": OPEN_LOOP, "CLIN": 0, "MAC": 0, "MDEC": 0, "MXPF": 100, "MXPR": 100},
        "MXRPM": round(MINUTE / (TURN * robot.k1)),
        "EPPR": round(robot.ticks_per_turn / COUNTS_A_PULSE),
        **{f"K{name.upper()}": round(getattr(loop, name) / TENTH) for name in "pid"},
    }
    of_all = {"RWD": [own.watchdog], "ECHOF": [0 if own.echo else 1], "MXMD": [0]}
    return of_all | {name: [value] * len(CHANNELS) for name, value in of_channel.items()}


def _place(channel: int) -> int:
    """Return the index of a channel, counted from 1."""
    if channel not in CHANNELS:
        raise ValueError
    return channel - 1


def _signed(count: int) -> int:
    """Return a count as a signed number of 32 bits."""
    return (count + 2**31) % 2**32 - 2**31
