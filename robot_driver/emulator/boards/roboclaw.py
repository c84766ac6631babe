"""The state of an emulated RoboClaw: motors with their loops, encoders, registers, the timeout.

Motor and encoder 1 are the left side, 2 the right side. The manual does not print the law of the velocity loop;
`motor_channel` takes the P, I and D of the registers as shares of the full duty, times 65536.
"""

import math
from collections.abc import Callable, Sequence
from typing import TypeAlias

from robot_driver.emulator.boards.motor_channel import AT_ONCE, LOOP_PERIOD, Gains, MotorChannel, Rates
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.settings import Settings

FULL_DUTY = 32767
PID_UNIT = 65536
TIMEOUT_UNIT = 0.1  # s
AVERAGE_PERIOD = 1.0  # s; command 108 averages over the last full second
HEALTHY = 0  # status word of command 90
KEY = 0xE22EAB7A  # without it nothing is written to the memory
MOTORS = (0, 1)
TURN = 2.0 * math.pi

Pair: TypeAlias = Sequence[int | None]  # of motors 1 and 2; None: as before


class RefusedError(ValueError):
    """A value that the manual does not allow; the packet is not answered."""


class RoboclawBoard:
    """The board behind one address; it drives `plant`, through `command` if that is given.

    `time` (s) is now. `registers` are all settings by name, `memory` those in non-volatile memory.
    """

    def __init__(self, settings: Settings, plant: Plant, command: Callable[[float, float], None] | None = None) -> None:
        self.settings = settings
        self.plant = plant
        self.time = 0.0
        self.motors = (MotorChannel(), MotorChannel())
        self.registers = set_up_settings(settings)
        self.memory = dict(self.registers)
        self.saves = 0
        self.timeout = 0.0
        self.encoder_zero = [0, 0]
        self.average_speeds = (0, 0)
        self.average_due = AVERAGE_PERIOD
        self.loop_due = math.inf
        self._command = command or plant.command
        self._average_start = self.counts()
        self._mix: dict[str, float] = {}

    @property
    def duty(self) -> list[int]:
        """The duties applied to the motors."""
        return [round(motor.duty * FULL_DUTY) for motor in self.motors]

    @property
    def drives(self) -> bool:
        """Whether a motor turns, or is commanded to."""
        return any(motor.drives for motor in self.motors)

    def drive(self, duties: Pair, accelerations: Pair = (None, None)) -> None:
        """Set duties, with these rates of change per second; by default those in the registers; 0: at once."""
        for motor, duty, acceleration in zip(MOTORS, duties, accelerations, strict=True):
            default = self.registers[f"duty_acceleration_{motor + 1}"]
            rate = (default if acceleration is None else acceleration) / FULL_DUTY
            if duty is not None:
                self.motors[motor].drive(duty / FULL_DUTY, _rates(rate))
        self._step(0.0)

    def turn(self, speeds: Pair, accelerations: Sequence[int] = (0, 0)) -> None:
        """Regulate speeds (counts/s), with these rates of change per second; 0: at once."""
        measured = self.speeds()
        for motor, speed, acceleration in zip(MOTORS, speeds, accelerations, strict=True):
            if speed is not None:
                self.motors[motor].follow(speed, measured[motor], _rates(acceleration))
        self._step(0.0)

    def mix(self, **part: float) -> None:
        """Drive by `forward` and `right` (-1 to 1), once both have been received."""
        self._mix.update(part)
        if len(self._mix) == len(MOTORS):
            forward, right = self._mix["forward"], self._mix["right"]
            self.drive([round(FULL_DUTY * side) for side in (forward + right, forward - right)])

    def stop(self) -> None:
        """Stop the motors at once."""
        for motor in self.motors:
            motor.drive(0.0)
        self._step(0.0)

    def switch_on(self) -> None:
        """Restart from the memory, as after power-off."""
        self.registers, self.timeout, self._mix = dict(self.memory), 0.0, {}
        for motor in MOTORS:
            self.set_count(motor, 0)
        self.stop()

    def go_on(self) -> None:
        """Perform everything due by now: step the loops, measure the average speeds."""
        while self.loop_due <= self.time:
            self.loop_due += LOOP_PERIOD
            self._step(LOOP_PERIOD)
        if self.time >= self.average_due:
            counts = self.counts()
            self.average_speeds = (counts[0] - self._average_start[0], counts[1] - self._average_start[1])
            self._average_start = counts
            self.average_due += AVERAGE_PERIOD

    def set_count(self, motor: int, count: int) -> None:
        """Set an encoder's count; the average speeds are not affected."""
        self.encoder_zero[motor] = self.counts()[motor] - count

    def save(self, key: int) -> None:
        """Write the registers to the memory."""
        if key != KEY:
            raise RefusedError
        self.memory = dict(self.registers)
        self.saves += 1

    def restore_factory_settings(self) -> None:
        """Restore the factory settings."""
        self.registers = factory_settings()

    def counts(self) -> tuple[int, int]:
        """Return the counts of both encoders since power-up."""
        left, right = self.plant.encoder_counts()
        return math.floor(left), math.floor(right)

    def encoders(self) -> tuple[int, int]:
        """Return both registers: counts since they were set, modulo 2^32."""
        left, right = self.counts()
        return (left - self.encoder_zero[0]) & 0xFFFFFFFF, (right - self.encoder_zero[1]) & 0xFFFFFFFF

    def speeds(self) -> tuple[int, int]:
        """Return both speeds (counts/s)."""
        left, right = self.plant.encoder_speeds()
        return round(left), round(right)

    def set_speeds(self) -> list[int]:
        """Return the speeds regulated now (counts/s); 0 for none."""
        return [round(motor.speed or 0.0) for motor in self.motors]

    def speed_errors(self) -> list[int]:
        """Return the errors of the regulated speeds (counts/s); 0 where none is regulated."""
        both = zip(self.motors, self.speeds(), strict=True)
        return [abs(round(motor.speed) - speed) if motor.speed is not None else 0 for motor, speed in both]

    def currents(self) -> tuple[int, int]:
        """Return both currents in units of 10 mA."""
        left, right = self.plant.motor_currents()
        return round(left * 100.0), round(right * 100.0)

    def _step(self, seconds: float) -> None:
        """Step channels that are busy, and apply their duties to the motors."""
        measured = self.plant.encoder_speeds()
        for motor, channel in enumerate(self.motors):
            if channel.is_busy:
                channel.step(measured[motor], seconds, self._gains(motor))
        self._command(self.motors[0].duty, self.motors[1].duty)
        if not any(channel.is_busy for channel in self.motors):
            self.loop_due = math.inf
        elif math.isinf(self.loop_due):
            self.loop_due = self.time + LOOP_PERIOD

    def _gains(self, motor: int) -> Gains:
        p, i, d = (self.registers[f"velocity_{gain}_{motor + 1}"] / PID_UNIT for gain in "pid")
        return Gains(p, i, d, self.registers[f"velocity_qpps_{motor + 1}"])


def factory_settings() -> dict[str, int]:
    """Return all registers with their factory values; those not named here are 0."""
    limits = {"main_min": 60, "main_max": 340, "logic_min": 60, "logic_max": 340}  # 0.1 V
    loop = {"velocity_qpps": 44000, "velocity_p": 0x10000, "velocity_i": 0x8000, "velocity_d": 0x4000}
    return dict.fromkeys(_REGISTERS, 0) | limits | _of_both(loop) | _of_both({"current_max": 3000})  # 10 mA


def set_up_settings(settings: Settings) -> dict[str, int]:
    """Return all registers of a robot that was set up, with tuned loops."""
    robot, loop = settings.robot, settings.speed_loop
    gains = {f"velocity_{gain}": round(getattr(loop, gain) * PID_UNIT) for gain in "pid"}
    full_speed = {"velocity_qpps": round(robot.ticks_per_turn / (TURN * robot.k1))}
    return factory_settings() | _of_both(gains | full_speed)


def _of_both(values: dict[str, int]) -> dict[str, int]:
    """Return registers of both motors with the same values."""
    return {f"{name}_{motor + 1}": value for name, value in values.items() for motor in MOTORS}


# Names of registers that exist per motor, and of the others.
_OF_A_MOTOR = (
    *("velocity_p", "velocity_i", "velocity_d", "velocity_qpps"),
    *("position_p", "position_i", "position_d", "position_max_i", "position_deadzone", "position_min", "position_max"),
    *("duty_acceleration", "default_speed", "encoder_mode", "homing_speed", "homing_timeout"),
    *("speed_error", "position_error", "blanking", "current_max", "current_min", "control"),
)
_OTHERS = (
    *("main_min", "main_max", "logic_min", "logic_max", "main_offset", "logic_offset"),
    *("pin_s3", "pin_s4", "pin_s5", "deadband_reverse", "deadband_forward"),
    *("configuration", "control_mode_1", "control_mode_2", "pwm_mode"),
)
_REGISTERS = (*(f"{name}_{motor + 1}" for name in _OF_A_MOTOR for motor in MOTORS), *_OTHERS)


def _rates(rate: float) -> Rates:
    """Return a ramp; the manual does not say what 0 means, and here it means none."""
    return Rates(rate, rate) if rate else AT_ONCE
