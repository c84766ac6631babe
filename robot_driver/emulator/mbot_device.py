"""The device's side of the MBot control board: motors, encoders, gyro and battery behind one USB port.

Index 0 is the left wheel, 1 the right one, which turns the other way: forward is + and -. Speeds of wheels and of the
body are driven in open loop, with the motor calibration stored on the board. Sources: mbot-project/mbot_firmware,
src/mbot_classic.c, src/mbot_comms.c and comms/src/listener.c.
"""

import math
import struct
from collections.abc import Callable
from ctypes import c_float, c_int64

from robot_driver.emulator.boards.mbot_topics import (
    ANALOG_IN,
    ENCODERS,
    ENCODERS_RESET,
    IMU,
    MOTOR_PWM,
    MOTOR_PWM_CMD,
    MOTOR_VEL,
    MOTOR_VEL_CMD,
    ODOMETRY,
    ODOMETRY_RESET,
    SAID,
    TAKEN,
    TIMESYNC,
    VEL,
    VEL_CMD,
)
from robot_driver.emulator.device import NotUnderstood, Transmission, byte_time
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.sensors import YawGyro
from robot_driver.emulator.settings import Settings

START = b"\xff\xfe"
HEADER_BYTES, FRAME_BYTES = 7, 8  # up to the payload; all that is not payload
GRAVITY = 9.81  # m/s^2
NO_FIELD, UPRIGHT = (0.0,) * 3, (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)  # magnetometer; roll, pitch, yaw, quaternion
LONGEST_STEP = 2**31 - 1  # us
BATTERY_DIVIDER = 5.0
RAW_PER_VOLT = 4096 / 3.3
LARGEST_DUTY = 0.995  # limit of the firmware


class MBotDevice:
    """A board of the classic kind that drives `plant`.

    `not_understood` counts frames of unknown topics, by number, and damaged ones.
    """

    def __init__(self, settings: Settings, plant: Plant) -> None:
        self.byte_time = byte_time(0)  # USB
        self.duty = (0.0, 0.0)
        self.not_understood = NotUnderstood()
        self.wake_time = self._period = 1.0 / settings.mbot.rate
        self._settings = settings
        self._plant = plant
        self._gyro = YawGyro(settings, plant)
        self._waiting = b""
        self._commanded = (0.0, 0.0)
        self._clock_offset = 0  # us
        self._told_time = -math.inf  # s
        self._is_told_time = False
        self._counts = (0, 0)
        self._count_zero = (0, 0)
        self._last_utime = 0
        self._odometry = (0.0, 0.0, 0.0)  # x, y (m), heading (rad)
        self._against_friction = settings.plant.coulomb_friction / settings.robot.k2_over_k3  # duty
        crossed = settings.mbot.takes_velocities
        self._takes: dict[int, Callable[..., None]] = {
            ODOMETRY_RESET: self._take_odometry,
            VEL_CMD: self._take_velocity,
            ENCODERS_RESET: self._take_counts,
            MOTOR_PWM_CMD: self._take_wheel_speeds if crossed else self._take_duties,
            MOTOR_VEL_CMD: self._take_duties if crossed else self._take_wheel_speeds,
        }

    def receive(self, data: bytes, time: float) -> list[Transmission]:
        """Process bytes; execute complete commands. Nothing is answered at once."""
        self._waiting += data
        while (start := self._waiting.find(START)) >= 0:
            self._waiting = self._waiting[start:]
            if len(self._waiting) < HEADER_BYTES:
                return []
            length, check, topic = struct.unpack_from("<HBH", self._waiting, 2)
            if check != checksum(self._waiting[2:4]) or not self._is_known(topic, length):
                self._waiting = self._waiting[2:]
                continue
            if len(self._waiting) < FRAME_BYTES + length:
                return []
            body, check = self._waiting[5 : HEADER_BYTES + length], self._waiting[HEADER_BYTES + length]
            if check == checksum(body):
                self._carry_out(topic, body[2:], time)
            else:
                self.not_understood.note("wrong checksum")
            self._waiting = self._waiting[FRAME_BYTES + length :]
        self._waiting = self._waiting[-1:]  # possibly the first start byte of a frame
        return []

    def wake(self, time: float) -> list[Transmission]:
        """Run the board's loop once: measure, drive and, while the time is known, send everything."""
        self.wake_time += self._period
        rate = self._gyro.rate(self._period)
        forward, turning = self._body()
        self._odometry = _moved(self._odometry, forward * self._period, turning * self._period)
        said = b""
        if self._is_told_time:
            self._drive(self._commanded)
            said = self._everything(self._clock(time), rate)
        if time - self._told_time > self._settings.mbot.watchdog and not self._settings.mbot.ignores_watchdog:
            self._drive((0.0, 0.0))
            self._is_told_time = False
        return [Transmission(time, said)] if said else []

    def _is_known(self, topic: int, length: int) -> bool:
        """Return whether a topic is known, with a payload of this length; count those that are not."""
        known = topic in TAKEN and struct.calcsize(TAKEN[topic].layout) == length
        if not known:
            self.not_understood.note(f"topic {topic}" if topic in TAKEN or topic in SAID else "unknown topic")
        return known

    def _carry_out(self, topic: int, payload: bytes, time: float) -> None:
        utime, *values = struct.unpack(TAKEN[topic].layout, payload)
        if topic == TIMESYNC:
            self._take_time(utime, time)
        else:
            self._takes[topic](*values)

    def _take_time(self, utime: int, time: float) -> None:
        self._clock_offset = utime - round(time * 1e6)
        self._told_time, self._is_told_time = time, True

    def _take_odometry(self, x: float, y: float, theta: float) -> None:
        self._odometry = x, y, theta

    def _take_counts(self, left: int, right: int, *_unused: int) -> None:
        counts = self._turned()
        self._count_zero = counts[0] - left, counts[1] - right

    def _take_duties(self, left: float, right: float, _third: float) -> None:
        self._commanded = left, right

    def _take_wheel_speeds(self, left: float, right: float, _third: float) -> None:
        self._commanded = self._calibrated(left), self._calibrated(right)

    def _take_velocity(self, forward: float, _sideways: float, turning: float) -> None:
        robot = self._settings.robot
        of_turn = 0.5 * robot.base_width * turning
        left, right = ((sign * forward - of_turn) / robot.wheel_radius for sign in (1.0, -1.0))
        self._take_wheel_speeds(left, right, 0.0)

    def _calibrated(self, speed: float) -> float:
        """Return the duty for a wheel speed (rad/s) by the board's calibration; 0 for NaN."""
        if not abs(speed) > 0.0:
            return 0.0
        return c_float(self._settings.robot.k1 * speed + math.copysign(self._against_friction, speed)).value

    def _clock(self, time: float) -> int:
        return c_int64(round(time * 1e6) + self._clock_offset).value

    def _drive(self, duty: tuple[float, float]) -> None:
        if duty != self.duty:
            self.duty = duty
            self._plant.command(_for_motor(duty[0]), _for_motor(-duty[1]))

    def _wheels(self) -> tuple[float, float]:
        """Return the speeds of both wheels (rad/s)."""
        return self._plant.left.velocity, -self._plant.right.velocity

    def _body(self) -> tuple[float, float]:
        """Return the velocity forwards (m/s) and the rate of turn (rad/s) by the wheels."""
        (left, right), robot = self._wheels(), self._settings.robot
        return robot.wheel_radius * (left - right) / 2.0, robot.wheel_radius * (-left - right) / robot.base_width

    def _everything(self, utime: int, rate: float) -> bytes:
        """Return the frames that one cycle of the loop sends, in the firmware's order."""
        imu = (0.0, 0.0, rate, 0.0, 0.0, GRAVITY, *NO_FIELD, *UPRIGHT, 25.0)
        battery = self._plant.battery_voltage()
        raw = round(battery / BATTERY_DIVIDER * RAW_PER_VOLT)
        forward, turning = self._body()
        return b"".join(
            (
                self._frame(ENCODERS, utime, *self._encoders(utime)),
                self._frame(ODOMETRY, utime, *self._odometry),
                self._frame(IMU, utime, *imu),
                self._frame(ANALOG_IN, utime, 0, 0, 0, raw, 0.0, 0.0, 0.0, battery),
                self._frame(VEL, utime, forward, 0.0, turning),
                self._frame(MOTOR_VEL, utime, *self._wheels(), 0.0),
                self._frame(MOTOR_PWM, utime, *self.duty, 0.0),
            )
        )

    def _turned(self) -> tuple[int, int]:
        """Return the counts of both encoders since power-up."""
        left, right = self._plant.encoder_counts()
        return math.floor(left), -math.floor(right)

    def _encoders(self, utime: int) -> tuple[int, ...]:
        """Return counts, counts since the last turn of the loop, and its time (us)."""
        turned = self._turned()
        steps = (turned[0] - self._counts[0], turned[1] - self._counts[1])
        elapsed = max(-LONGEST_STEP, min(utime - self._last_utime, LONGEST_STEP))
        self._counts, self._last_utime = turned, utime
        counts = [c_int64(count - zero).value for count, zero in zip(turned, self._count_zero, strict=True)]
        return *counts, 0, *steps, 0, elapsed

    def _frame(self, topic: int, *values: float) -> bytes:
        return frame(topic + self._settings.mbot.topics_from, struct.pack(SAID[topic].layout, *values))


def frame(topic: int, payload: bytes) -> bytes:
    """Return a payload as it goes over the wire."""
    body, length = struct.pack("<H", topic) + payload, struct.pack("<H", len(payload))
    return START + length + bytes([checksum(length)]) + body + bytes([checksum(body)])


def checksum(data: bytes) -> int:
    """Return 255 minus the sum of all bytes modulo 256."""
    return 255 - sum(data) % 256


def _for_motor(duty: float) -> float:
    """Return the duty for the motor; 0 if it is not a number."""
    return 0.0 if math.isnan(duty) else max(-LARGEST_DUTY, min(LARGEST_DUTY, duty))


def _moved(odometry: tuple[float, float, float], way: float, turned: float) -> tuple[float, float, float]:
    """Return x, y (m) and heading (rad) after a way (m) and a turn (rad); motion that is not finite is ignored."""
    x, y, theta = odometry
    if not math.isfinite(theta):
        return odometry
    return x + way * math.cos(theta), y + way * math.sin(theta), theta + turned
