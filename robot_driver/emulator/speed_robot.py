"""An emulated robot with a velocity controller inside: directly on the bus, as through a bridge to its own software.

The code of cmr-driver decides which commands may move it.
"""

import math
from typing import TypeAlias

from cmr.bus.claiming import Ownership
from cmr.bus.message import Message
from cmr.bus.messages import make
from cmr.bus.process import Outgoing
from cmr.bus.streams import GYRO, MOTOR_FEEDBACK, POSE, VELOCITY_COMMAND, WHEEL_SPEED_COMMAND, Stream
from cmr.model.command_kinds import VELOCITY, WHEEL_SPEED
from cmr.msg import (
    command_claim_t,
    command_owner_t,
    estop_latch_t,
    estop_t,
    gyro_t,
    motor_feedback_t,
    pose_xyt_t,
    velocity_command_t,
    wheel_speed_command_t,
)
from cmr.plant.commanded import wheel_speeds_of
from robot_driver.bus_stop import BusStop
from robot_driver.clock import Stamps
from robot_driver.command_gate import CommandGate
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.sensors import MotionCapture, Pose, YawGyro
from robot_driver.emulator.settings import Settings
from robot_driver.encoders import FASTEST_WHEEL, WheelEncoders
from robot_driver.host import THIS_COMPUTER, Host

Command: TypeAlias = wheel_speed_command_t | velocity_command_t
COMMANDS: dict[str, Stream[Command]] = {
    VELOCITY: VELOCITY_COMMAND,
    WHEEL_SPEED: WHEEL_SPEED_COMMAND,
}


class SpeedRobot:
    """The robot, switched on now; it takes commands of one kind, a name of COMMANDS. It is independent of the bus.

    `pose_rate` (Hz) is that of an external localisation; None for none.
    """

    def __init__(
        self, settings: Settings, robot_id: int, commands: str, pose_rate: float | None, host: Host = THIS_COMPUTER
    ) -> None:
        self.gate = CommandGate(largest=math.inf)  # larger speeds are clipped by the robot
        self._bus_stop = BusStop(self.gate, robot_id)  # no file: the robot ends with its process
        self._ownership = Ownership(robot_id, host)
        self.plant = Plant(settings, settings.plant_of_speeds)
        self._robot_id, self._command_type, self._host = robot_id, COMMANDS[commands].message_type, host
        self._commanded_on = COMMANDS[commands].channel(robot_id)
        self._gyro = YawGyro(settings, self.plant)
        self._encoders = WheelEncoders(round(settings.robot.ticks_per_turn))
        self._stamps = Stamps(host.utime_at), Stamps(host.utime_at)
        self._capture = None if pose_rate is None else MotionCapture(settings, self.plant, pose_rate)
        self._poses: list[Pose] = []  # measured, but not ready yet
        self._period = 1.0 / settings.velocity_controller.rate
        self._readings = 0
        self._outgoing: list[Outgoing] = []
        self._start = host.monotonic_ns()
        self._read(0.0)

    def turn(self) -> None:
        """Record that the process is alive; to be called before messages are handled."""
        self.gate.note_turn(self._host.seconds_since_boot())

    def handle(self, utime: int, channel: str, message: Message, sender: int | None = None) -> None:
        """Take a message from the bus; a command takes effect at its time, or at once if that has passed."""
        now = self._host.utime()
        if isinstance(message, estop_t):
            self._bus_stop.handle(message, utime, utime=now)
        elif isinstance(message, command_claim_t):
            self._ownership.claim(message, sender)
        elif isinstance(message, self._command_type) and channel == self._commanded_on:
            if not self._ownership.takes(sender):
                return
            speeds = self._wheel_speeds(message)
            if self.gate.offer(utime, *speeds, now=self._host.seconds_since_boot(), utime=now):
                self._go_on(self._now() - max(now - utime, 0) / 1e6)
                self._drive()

    def outgoing(self) -> list[Outgoing]:
        """Advance to the current time; return the measurements since the last call."""
        if self._status():
            self._drive()
        self._go_on(self._now())
        outgoing, self._outgoing = self._outgoing, []
        return outgoing

    def owner_reports(self) -> list[command_owner_t]:
        """Return the messages of COMMAND_OWNER_N to publish now: whose commands are accepted."""
        return self._ownership.reports()

    def stop_reports(self) -> list[estop_latch_t]:
        """Return the messages of ESTOP_LATCH_N to publish now: whether the emergency stop is engaged."""
        return self._bus_stop.reports(self._host.monotonic(), self._host.utime())

    def remarks(self) -> str:
        """Return, in sentences, what holds the robot and which commands were refused."""
        return " ".join(filter(None, (self._ownership.problem(), *self._bus_stop.remarks(), *self.gate.remarks())))

    def _wheel_speeds(self, command: Command) -> tuple[float, float]:
        """Return the wheel speeds (left, right) of a command (rad/s)."""
        if isinstance(command, wheel_speed_command_t):
            return command.psi_left, command.psi_right
        return wheel_speeds_of(self.plant.parameters, command.v, command.omega)

    def _status(self) -> int:
        return self.gate.drive(self._host.seconds_since_boot()).status

    def _drive(self) -> None:
        """Apply the command in force to the wheels."""
        drive, k1 = self.gate.drive(self._host.seconds_since_boot()), self.plant.parameters.k1
        self.plant.command(k1 * drive.left, k1 * drive.right)

    def _now(self) -> float:
        """Return the time since the robot was switched on (s)."""
        return (self._host.monotonic_ns() - self._start) / 1e9

    def _monotonic(self, time: float) -> int:
        return self._start + round(time * 1e9)

    def _go_on(self, until: float) -> None:
        """Advance to a time (s), with the sensors sampling at their times."""
        while True:
            reading = self._readings * self._period
            look = math.inf if self._capture is None else self._capture.wake_time
            due = min(reading, look)
            if due > until:
                break
            self.plant.advance(due)
            if self._capture is not None and look <= reading:
                self._poses.append(self._capture.wake(due))
            else:
                self._read(due)
        self.plant.advance(until)
        self._tell_poses(until)

    def _read(self, time: float) -> None:
        """Read encoders and gyro."""
        self._readings += 1
        left, right = self.plant.encoder_counts()
        measured = self._monotonic(time)
        motion = self._encoders.update((math.floor(left), math.floor(right)), measured, FASTEST_WHEEL)
        if motion is None:
            return
        utime = self._stamps[0].next(measured)
        nothing = dict.fromkeys(("applied_left", "applied_right", "current_left", "current_right"), math.nan)
        self._tell(
            MOTOR_FEEDBACK,
            make(
                motor_feedback_t,
                utime=utime,
                robot_id=self._robot_id,
                **dict(zip(("ticks_left", "ticks_right"), motion.ticks, strict=True)),
                **dict(zip(("psi_left", "psi_right"), motion.psi, strict=True)),
                **nothing,
                battery_voltage=math.nan,
                temperature=math.nan,
                status=self._status(),
                received_utime=utime,
                applied_utime=0,
            ),
        )
        # The mean rate since the last reading is that at half-time.
        turned = self._stamps[1].next(self._monotonic(time - 0.5 * self._period))
        rate = self._gyro.rate(self._period)
        self._tell(
            GYRO,
            make(gyro_t, utime=turned, robot_id=self._robot_id, yaw_rate=rate, valid=1, received_utime=utime),
        )

    def _tell_poses(self, until: float) -> None:
        """Publish the poses that are ready by then."""
        while self._poses and self._poses[0].ready <= until:
            pose = self._poses.pop(0)
            utime = self._host.utime_at(self._monotonic(pose.time))
            self._tell(
                POSE, make(pose_xyt_t, utime=utime, robot_id=self._robot_id, x=pose.x, y=pose.y, theta=pose.theta)
            )

    def _tell(self, stream: Stream[Message], message: Message) -> None:
        self._outgoing.append((stream, self._robot_id, message))
