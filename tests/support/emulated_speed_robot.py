"""An emulated robot with a velocity controller in simulated time, and somebody who commands it."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any

from cmr.bus.messages import make
from cmr.bus.streams import ESTOP, VELOCITY_COMMAND, WHEEL_SPEED_COMMAND
from cmr.geometry.manoeuvres import in_sequence
from cmr.model.command_kinds import VELOCITY
from cmr.msg import estop_t, motor_feedback_t, velocity_command_t, wheel_speed_command_t
from cmr.parameters.file import ParameterFile, Value
from cmr.recordings.commanding import command_of
from cmr.recordings.recording import Recorder, Recording
from robot_driver.command_gate import LISTENING_TIME
from robot_driver.emulator.settings import Settings
from robot_driver.emulator.speed_robot import COMMANDS, SpeedRobot
from robot_driver.host import Host

TURN, COMMAND_PERIOD = 0.005, 0.02  # s, of the emulator's process and of who commands
BEGINNING = 1_700_000_000_000_000  # us


class SimulatedClock(Host):
    """A computer whose clocks stand until somebody lets them go on; `time` [s] since it was switched on."""

    def __init__(self) -> None:
        self.time = 0.0

    def monotonic_ns(self) -> int:
        return round(self.time * 1e9)

    def seconds_since_boot(self) -> float:
        return self.time

    def utime_at(self, monotonic_nanoseconds: int) -> int:
        return BEGINNING + monotonic_nanoseconds // 1000

    def utime(self) -> int:
        return self.utime_at(self.monotonic_ns())


class CommandedBench(ABC):
    """A robot 0 in simulated time that is commanded; `heard` is what the bus has, as (channel, message)."""

    def __init__(self) -> None:
        self.clock = SimulatedClock()
        self.heard: list[tuple[str, Any]] = []

    @abstractmethod
    def turn(self) -> None:
        """Let everything go round once, TURN later."""

    @abstractmethod
    def send(self, channel: str, message: Any) -> None:
        """Publish a message, which the robot's process takes at its next turn."""

    @abstractmethod
    def velocity(self, v: float, omega: float = 0.0) -> None:
        """Command a velocity [m/s, rad/s]."""

    def wait(self, seconds: float) -> None:
        """Let time pass in silence."""
        for _ in range(round(seconds / TURN)):
            self.turn()

    def drive(self, v: float, omega: float = 0.0, *, seconds: float) -> None:
        """Command the same velocity again and again."""
        for _ in range(round(seconds / COMMAND_PERIOD)):
            self.velocity(v, omega)
            self.wait(COMMAND_PERIOD)

    def follow(self, nominal: ParameterFile, manoeuvre: str, kind: str = VELOCITY) -> None:
        """Command a manoeuvre as cmr-pilot does, and let the robot come to rest after it."""
        duties, controller = in_sequence(manoeuvre).duties(nominal.robot_parameters), nominal.velocity_controller
        begin = self.clock.time
        while (time := self.clock.time - begin) < duties.duration:
            left, right = map(float, duties.at(time))
            self.send(COMMANDS[kind].channel(0), command_of(kind, self.clock.utime(), 0, (left, right), controller))
            self.wait(COMMAND_PERIOD)
        self.wait(4.0)


class Bench(CommandedBench):
    """The robot 0, as its process runs it."""

    def __init__(self, settings: Settings, commands: str = VELOCITY, pose_rate: float | None = 50.0) -> None:
        super().__init__()
        self.robot = SpeedRobot(settings, 0, commands, pose_rate, self.clock)
        self.status = 0  # of the last feedback
        self._waiting: list[tuple[str, Any]] = []

    def send(self, channel: str, message: Any) -> None:
        """Publish a message, which the process takes at its next turn."""
        self._waiting.append((channel, message))

    def velocity(self, v: float, omega: float = 0.0, *, age: float = 0.0) -> None:
        """Command a velocity [m/s, rad/s], decided `age` [s] ago."""
        utime = self.clock.utime() - round(age * 1e6)
        message = make(velocity_command_t, utime=utime, robot_id=0, v=v, omega=omega)
        self.send(VELOCITY_COMMAND.channel(0), message)

    def wheel_speeds(self, left: float, right: float) -> None:
        """Command the speeds of wheels [rad/s]."""
        message = make(wheel_speed_command_t, utime=self.clock.utime(), robot_id=0, psi_left=left, psi_right=right)
        self.send(WHEEL_SPEED_COMMAND.channel(0), message)

    def estop(self, engaged: bool) -> None:
        """Engage or release the emergency stop."""
        message = make(estop_t, utime=self.clock.utime(), engaged=engaged, source="test", reason="a test")
        self.send(ESTOP.channel(), message)

    def turn(self) -> None:
        """Let the process go round once, TURN later."""
        self.clock.time += TURN
        self.robot.turn()
        waiting, self._waiting = self._waiting, []
        for channel, message in waiting:
            self.heard.append((channel, message))
            self.robot.handle(message.utime, channel, message)
        for stream, robot_id, message in self.robot.outgoing():
            self.heard.append((stream.channel(robot_id), message))
            if isinstance(message, motor_feedback_t):
                self.status = message.status

    @property
    def speed(self) -> float:
        """How fast the faster wheel turns [rad/s]."""
        return max(abs(self.robot.plant.left.velocity), abs(self.robot.plant.right.velocity))


def nominal_of(settings: Settings, **values: float) -> ParameterFile:
    """Return what the owner of the robot knows."""
    controller = settings.velocity_controller
    known = {
        "wheel_radius": settings.robot.wheel_radius,
        "base_width": settings.robot.base_width,
        "command_base_width": controller.command_base_width,
        "response_time": controller.response_time,
        "top_wheel_speed": controller.top_wheel_speed,
        **values,
    }
    return ParameterFile(0, {name: Value(value) for name, value in known.items()})


def recorded(
    settings: Settings, kind: str = VELOCITY, manoeuvre: str = "figure_eight", known: Mapping[str, float] | None = None
) -> Recording:
    """Return the recording of a manoeuvre that cmr-pilot drives with the parameters that the owner knows."""
    recorder = Recorder(0)
    for channel, message in messages_of(settings, kind, manoeuvre, known):
        recorder.handle(message.utime, channel, message)
    return recorder.recording()


def messages_of(
    settings: Settings, kind: str = VELOCITY, manoeuvre: str = "figure_eight", known: Mapping[str, float] | None = None
) -> list[tuple[str, Any]]:
    """Return the messages of such a drive, as (channel, message)."""
    bench = Bench(settings, kind)
    bench.wait(LISTENING_TIME)
    bench.follow(nominal_of(settings, **(known or {})), manoeuvre, kind)
    return bench.heard
