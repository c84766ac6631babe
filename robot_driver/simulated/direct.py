"""A robot without bytes and threads: what the driver makes of commands reaches the plant at once. For large studies.

It is a tenth of the work of the driver in simulated time, and leaves out what is between the two: ports, the last gate,
lost replies. So it judges only who commands and listens.
"""

import math
from collections.abc import Callable, Iterator

from cmr.bus.message import Message
from cmr.bus.messages import make
from cmr.bus.process import Outgoing
from cmr.bus.streams import GYRO, MOTOR_FEEDBACK
from cmr.model.duty_ramp import Ramp
from cmr.msg import gyro_t, motor_command_t, motor_feedback_t
from robot_driver.command_gate import CommandGate
from robot_driver.controllers.controller import COUNTER_RANGE
from robot_driver.emulator.hand_device import HandDevice
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.robot_in_time import RobotInTime
from robot_driver.emulator.sensors import MotionCapture, Pose, YawGyro
from robot_driver.emulator.settings import Settings
from robot_driver.encoders import WheelEncoders
from robot_driver.host import Host
from robot_driver.settings import Settings as DriverSettings
from robot_driver.simulated.host import START_UTIME

SECOND = 1e9  # ns
HAND = "hand"


class DirectHost(Host):
    """A computer whose time goes on only when somebody sleeps."""

    runs_processes = False

    def __init__(self, settings: Settings, plant: Plant, pose_rate: float, see: Callable[[int, Pose], None]) -> None:
        self.plant = plant
        capture = MotionCapture(settings, plant, pose_rate)
        self._now = 0.0
        self._robot = RobotInTime(
            plant,
            {HAND: HandDevice(settings, plant)},
            lambda _name, _data: None,
            motion_capture=capture,
            on_pose=lambda pose: see(START_UTIME + round(1e6 * pose.time), pose),
        )

    def monotonic(self) -> float:
        """Return the steady time (s)."""
        return self._now

    def monotonic_ns(self) -> int:
        """Return the steady time (ns)."""
        return round(SECOND * self._now)

    def seconds_since_boot(self) -> float:
        """Return the steady time (s)."""
        return self._now

    def utime_at(self, monotonic_nanoseconds: int) -> int:
        """Return the time of day (us) of a moment."""
        return START_UTIME + monotonic_nanoseconds // 1000

    def utime(self) -> int:
        """Return the time of day (us)."""
        return self.utime_at(self.monotonic_ns())

    def sleep(self, seconds: float) -> None:
        """Let the robot go on for so long."""
        self._now += seconds
        self._robot.let_happen(self._now)
        self.plant.advance(self._now)

    def write_to_hands(self, line: bytes) -> None:
        """Have the hands do something."""
        self._robot.bring(HAND, line, self._now)


class DirectDriver:
    """What bring-up sees of a driver, as a context manager."""

    def __init__(self, settings: DriverSettings, emulated: Settings, host: DirectHost, *, has_gyro: bool) -> None:
        self._settings, self._host, self._plant = settings, host, host.plant
        self._gate = CommandGate()
        self._ramp = Ramp(settings.limits, longest_step=0.1)
        self._encoders = WheelEncoders(settings.ticks_per_turn)
        self._gyro = YawGyro(emulated, host.plant) if has_gyro else None
        self._turned = host.monotonic()
        self._said: list[Outgoing] = []

    def __enter__(self) -> "DirectDriver":
        return self

    def __exit__(self, *_: object) -> None:
        self._plant.command(0.0, 0.0)

    def handle(self, utime: int, channel: str, message: Message, sender: int | None = None) -> None:
        """Take a command."""
        del channel, sender
        if isinstance(message, motor_command_t):
            now, time = self._host.seconds_since_boot(), self._host.utime()
            self._gate.offer(utime, message.left, message.right, now=now, utime=time)

    def turn(self) -> None:
        """Drive and measure once."""
        host, settings = self._host, self._settings
        now = host.monotonic()
        seconds, self._turned = now - self._turned, now
        self._gate.note_turn(now)
        if seconds <= 0.0:
            return
        drive = self._gate.drive(now)
        duties = self._ramp.towards(drive.left, drive.right, now)
        self._ramp.acknowledge()
        self._ramp.confirm()
        self._plant.command(*settings.wiring.channels(*duties))
        first, second = (math.floor(count) % COUNTER_RANGE for count in self._plant.encoder_counts())
        motion = self._encoders.update(settings.wiring.forward_counts(first, second), host.monotonic_ns(), 200.0)
        utime = host.utime()
        if motion is not None:
            feedback = make(
                motor_feedback_t,
                utime=utime,
                robot_id=settings.robot,
                ticks_left=motion.ticks[0],
                ticks_right=motion.ticks[1],
                psi_left=motion.psi[0],
                psi_right=motion.psi[1],
                applied_left=duties[0],
                applied_right=duties[1],
                current_left=math.nan,
                current_right=math.nan,
                battery_voltage=self._plant.battery_voltage(),
                temperature=math.nan,
                status=drive.status,
                received_utime=utime,
                applied_utime=utime,
            )
            self._said.append((MOTOR_FEEDBACK, settings.robot, feedback))
        if self._gyro is not None:
            rate = self._gyro.rate(seconds) * (-1.0 if settings.invert_gyro else 1.0)
            reading = make(gyro_t, utime=utime, robot_id=settings.robot, yaw_rate=rate, valid=1, received_utime=utime)
            self._said.append((GYRO, settings.robot, reading))

    def outgoing(self) -> Iterator[Outgoing]:
        """Yield what has been measured."""
        said, self._said = self._said, []
        yield from said

    def news(self) -> Iterator[str]:
        """Yield nothing."""
        return iter(())

    def problems(self) -> str:
        """Return nothing: nothing fails."""
        return ""
