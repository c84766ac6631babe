"""The device's side of the MBot control board: motors, encoders, gyro and battery behind one USB port.

Index 0 is the left wheel, 1 the right one, which turns the other way: forward is + and -. Sources:
mbot-project/mbot_firmware, src/mbot_classic.c, src/mbot_comms.c and comms/src/listener.c.
"""

import math
import struct

from robot_driver.emulator.device import Transmission, byte_time
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.sensors import YawGyro
from robot_driver.emulator.settings import Settings

START = b"\xff\xfe"
TIMESYNC, MOTOR_PWM_CMD = 201, 230
LENGTHS = {TIMESYNC: 8, MOTOR_PWM_CMD: 20}  # bytes of the commands that are known here
ODOMETRY, IMU, ENCODERS, ANALOG_IN, MOTOR_VEL, MOTOR_PWM, VEL = 210, 220, 221, 223, 232, 233, 234
GRAVITY = 9.81  # m/s^2
NO_FIELD, UPRIGHT = (0.0,) * 3, (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)  # magnetometer; roll, pitch, yaw, quaternion
LONGEST_STEP = 2**31 - 1  # us
BATTERY_DIVIDER = 5.0
RAW_PER_VOLT = 4096 / 3.3


class MBotDevice:
    """A board of the classic kind that drives `plant`; it knows the commands for duties and the time."""

    def __init__(self, settings: Settings, plant: Plant) -> None:
        self.byte_time = byte_time(0)  # USB
        self.duty = (0.0, 0.0)
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
        self._last_utime = 0

    def receive(self, data: bytes, time: float) -> list[Transmission]:
        """Take bytes; carry out the commands that are complete. Nothing is answered at once."""
        self._waiting += data
        while (start := self._waiting.find(START)) >= 0:
            self._waiting = self._waiting[start:]
            if len(self._waiting) < 7:
                break
            length, check, topic = struct.unpack_from("<HBH", self._waiting, 2)
            if LENGTHS.get(topic) != length or check != checksum(self._waiting[2:4]):
                self._waiting = self._waiting[2:]
                continue
            if len(self._waiting) < 8 + length:
                break
            body, check = self._waiting[5 : 7 + length], self._waiting[7 + length]
            if check == checksum(body):
                self._carry_out(topic, body[2:], time)
            self._waiting = self._waiting[8 + length :]
        return []

    def wake(self, time: float) -> list[Transmission]:
        """Go through the board's loop once: measure, drive and say everything while the time is known."""
        self.wake_time += self._period
        rate = self._gyro.rate(self._period)
        said = b""
        if self._is_told_time:
            self._drive(self._commanded)
            said = self._everything(self._clock(time), rate)
        if time - self._told_time > self._settings.mbot.watchdog and not self._settings.mbot.ignores_watchdog:
            self._drive((0.0, 0.0))
            self._is_told_time = False
        return [Transmission(time, said)] if said else []

    def _carry_out(self, topic: int, payload: bytes, time: float) -> None:
        if topic == TIMESYNC:
            (utime,) = struct.unpack("<q", payload)
            self._clock_offset = utime - round(time * 1e6)
            self._told_time, self._is_told_time = time, True
        elif topic == MOTOR_PWM_CMD:
            _, left, right, _ = struct.unpack("<q3f", payload)
            scale = self._settings.robot.k1 if self._settings.mbot.takes_velocities else 1.0
            self._commanded = (scale * left, scale * right)

    def _clock(self, time: float) -> int:
        return round(time * 1e6) + self._clock_offset

    def _drive(self, duty: tuple[float, float]) -> None:
        if duty != self.duty:
            self.duty = duty
            self._plant.command(duty[0], -duty[1])

    def _everything(self, utime: int, rate: float) -> bytes:
        """Return what one turn of the loop says, in the firmware's order."""
        wheels = (self._plant.left.velocity, -self._plant.right.velocity)
        robot = self._settings.robot
        forward = robot.wheel_radius * (wheels[0] - wheels[1]) / 2.0
        turning = robot.wheel_radius * (-wheels[0] - wheels[1]) / robot.base_width
        imu = (0.0, 0.0, rate, 0.0, 0.0, GRAVITY, *NO_FIELD, *UPRIGHT, 25.0)
        battery = self._plant.battery_voltage()
        raw = round(battery / BATTERY_DIVIDER * RAW_PER_VOLT)
        return b"".join(
            (
                self._encoders(utime),
                self._frame(ODOMETRY, struct.pack("<q3f", utime, self._plant.x, self._plant.y, self._plant.theta)),
                self._frame(IMU, struct.pack("<q17f", utime, *imu)),
                self._frame(ANALOG_IN, struct.pack("<q4h4f", utime, 0, 0, 0, raw, 0.0, 0.0, 0.0, battery)),
                self._frame(VEL, struct.pack("<q3f", utime, forward, 0.0, turning)),
                self._frame(MOTOR_VEL, struct.pack("<q3f", utime, *wheels, 0.0)),
                self._frame(MOTOR_PWM, struct.pack("<q3f", utime, *self.duty, 0.0)),
            )
        )

    def _encoders(self, utime: int) -> bytes:
        left, right = self._plant.encoder_counts()
        counts = (math.floor(left), -math.floor(right))
        steps = (counts[0] - self._counts[0], counts[1] - self._counts[1])
        elapsed = min(utime - self._last_utime, LONGEST_STEP)
        self._counts, self._last_utime = counts, utime
        return self._frame(ENCODERS, struct.pack("<q3q3ii", utime, *counts, 0, *steps, 0, elapsed))

    def _frame(self, topic: int, payload: bytes) -> bytes:
        return frame(topic + self._settings.mbot.topics_from, payload)


def frame(topic: int, payload: bytes) -> bytes:
    """Return a payload as it goes over the wire."""
    body, length = struct.pack("<H", topic) + payload, struct.pack("<H", len(payload))
    return START + length + bytes([checksum(length)]) + body + bytes([checksum(body)])


def checksum(data: bytes) -> int:
    """Return 255 minus the sum of all bytes modulo 256."""
    return 255 - sum(data) % 256
