"""cmr-driver without the bus and the command line: ports, safety, parameters, and reports."""

import queue
from collections.abc import Iterator
from contextlib import ExitStack
from types import TracebackType

from cmr.bus.claiming import Ownership
from cmr.bus.message import Message
from cmr.bus.process import Outgoing
from cmr.bus.streams import GYRO, MOTOR_COMMAND, MOTOR_DUTY, MOTOR_FEEDBACK, Stream
from cmr.msg import command_claim_t, command_owner_t, estop_latch_t, estop_t, motor_command_t
from cmr.parameters.following import ParameterFollower
from robot_driver.bus_stop import BusStop
from robot_driver.command_gate import CommandGate
from robot_driver.commanders import Commanders
from robot_driver.controllers import CONTROLLERS
from robot_driver.encoders import FASTEST_WHEEL
from robot_driver.gyro_device import GyroDevice
from robot_driver.gyros import GYROS, Gyro
from robot_driver.host import THIS_COMPUTER, Host
from robot_driver.last_gate import Plan, gate_of
from robot_driver.motors import Motors
from robot_driver.port_thread import PortThread
from robot_driver.serial_port import SerialPort, numbering_warning
from robot_driver.settings import BOARD, Settings
from robot_driver.stop_file import StopFile, StopKeeper
from robot_driver.stream_port import OverheardPort, StreamPort


class Driver:
    """The driver of one robot, as a context manager: inside, the ports are open and the motors follow commands.

    Independent of the bus: `handle` takes messages, `outgoing` returns those to publish. Raises PortLost on entry if a
    port cannot be opened. On leaving, the motors have been stopped, with an acknowledgement if the device answers.

    An emergency stop that is engaged according to `stop_file` holds the motors before any port is opened.
    """

    def __init__(self, settings: Settings, host: Host = THIS_COMPUTER, stop_file: StopFile | None = None) -> None:
        self._host = host
        self.follower = ParameterFollower(settings.robot, settings.parameters)
        self.warnings = " ".join(filter(None, map(numbering_warning, (settings.port, settings.gyro_port or ""))))
        self._robot_id = settings.robot
        self._commanded_on = MOTOR_COMMAND.channel(settings.robot)
        self._outgoing: queue.SimpleQueue[tuple[Stream[Message], Message]] = queue.SimpleQueue()
        self._gate = CommandGate()
        self._stop_keeper = StopKeeper(stop_file) if stop_file is not None else None
        self._bus_stop = BusStop(self._gate, settings.robot, self._stop_keeper)
        self._commanders, self._ownership = Commanders(), Ownership(settings.robot, host)
        controller_type = CONTROLLERS[settings.controller]
        port_type = StreamPort if controller_type.streams else SerialPort
        port = port_type(settings.port, settings.baud or controller_type.default_baud_rate, host)
        latch = stop_file.path if stop_file is not None else None
        self._last_gate = gate_of(Plan(settings.controller, settings.wiring, settings.rate, latch), self._gate, host)
        port.guard = self._last_gate.guard
        self._motors = Motors(
            port,
            controller_type,
            self._gate,
            robot_id=settings.robot,
            rate_hz=settings.rate,
            ticks_per_turn=settings.ticks_per_turn,
            wiring=settings.wiring,
            limits=settings.limits,
            thresholds=settings.thresholds,
            publish=lambda message: self._outgoing.put((MOTOR_FEEDBACK, message)),
            publish_duty=lambda message: self._outgoing.put((MOTOR_DUTY, message)),
        )
        self._threads = [PortThread(port, self._motors)]
        self._gyro: GyroDevice | None = None
        gyro = _gyro(settings, port)
        if gyro is not None:
            self._gyro = self._gyro_device(settings, *gyro)
            self._threads.append(PortThread(gyro[0], self._gyro))
        self._inside = ExitStack()
        self._use_parameters()

    def __enter__(self) -> "Driver":
        with ExitStack() as inside:
            if self._stop_keeper is not None:
                inside.enter_context(self._stop_keeper)
            inside.enter_context(self._last_gate)
            for thread in reversed(self._threads):  # the motors' last, when everything else runs
                inside.enter_context(thread)
            self._inside = inside.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for thread in self._threads:  # all at once, so that none waits for another
            thread.ask_to_stop()
        self._inside.__exit__(kind, error, trace)

    def turn(self) -> None:
        """Record that the process is alive, and check the parameter file; to be called before messages are handled.

        The process must have subscribed to the bus before the first call.
        """
        self._gate.note_turn(self._host.seconds_since_boot())
        if self._last_gate.has_intervened():
            self._gate.clear()
        self._last_gate.feed()
        if self.follower.poll():
            self._use_parameters()

    def handle(self, utime: int, channel: str, message: Message, sender: int | None = None) -> None:
        """Take a message from the bus; `sender` is the name of the process that sent it, if it is known."""
        if isinstance(message, motor_command_t) and channel == self._commanded_on:
            if not self._ownership.takes(sender):
                return
            self._commanders.take(utime, message.left, message.right)
            self._gate.offer(
                utime, message.left, message.right, now=self._host.seconds_since_boot(), utime=self._host.utime()
            )
            self._last_gate.feed()
        elif isinstance(message, command_claim_t):
            self._ownership.claim(message, sender)
        elif isinstance(message, estop_t):
            self._bus_stop.handle(message, utime, utime=self._host.utime())
            self._last_gate.feed()
        elif self.follower.handle(utime, channel, message):
            self._use_parameters()

    def outgoing(self) -> Iterator[Outgoing]:
        """Yield what has been measured since the last call, as (stream, robot id, message)."""
        while not self._outgoing.empty():
            stream, message = self._outgoing.get()
            yield stream, self._robot_id, message

    def owner_reports(self) -> list[command_owner_t]:
        """Return the messages of COMMAND_OWNER_N to publish now: whose commands are accepted."""
        return self._ownership.reports()

    def stop_reports(self) -> list[estop_latch_t]:
        """Return the messages of ESTOP_LATCH_N to publish now: whether the emergency stop is engaged."""
        return self._bus_stop.reports(self._host.monotonic(), self._host.utime())

    def news(self) -> Iterator[str]:
        """Yield events since the last call, as text for the user."""
        for news in (self._bus_stop.news, self._ownership.news, self._last_gate.news):
            while news:
                yield news.pop(0)
        while not self._motors.news.empty():
            yield self._motors.news.get()

    @property
    def farewell(self) -> str:
        """Describe the state of the motors at the end, once the driver has been left."""
        if self._motors.stopped:
            return "motors stopped, zero acknowledged"
        return "zero was not acknowledged: the controller's own watchdog stops the motors"

    def problems(self) -> str:
        """Return what limits the driver's function, in sentences; "" if nothing does.

        Raises the exception that ended a port's thread, if it was a program error.
        """
        found = [self._bus_stop.problem, *(thread.problem for thread in self._threads)]
        found += [self._ownership.problem() or self._commanders.problem(self._host.utime())]
        return " ".join(filter(None, found))

    def remarks(self) -> str:
        """Return further remarks for the user, in sentences."""
        remarks = [*self._bus_stop.remarks(), self.warnings, self.follower.message, self._motors.rhythm.sentence()]
        remarks += [*self._gate.remarks(), *self._last_gate.remarks()]
        if self._motors.faults:
            remarks.append(f"Replies lost or damaged: {self._motors.faults}.")
        if self._gyro is not None and any(self._gyro.counts.values()):
            counts = ", ".join(f"{reason} {count}" for reason, count in sorted(self._gyro.counts.items()) if count)
            remarks.append(f"Yaw rates missing: {counts}.")
        if self._motors.jumps:
            remarks.append(f"Encoder jumps not counted: {self._motors.jumps}.")
        return " ".join(remark for remark in remarks if remark)

    def _gyro_device(self, settings: Settings, port: SerialPort, gyro_type: type[Gyro]) -> GyroDevice:
        return GyroDevice(
            port,
            gyro_type,
            robot_id=settings.robot,
            sign=-1 if settings.invert_gyro else 1,
            publish=lambda message: self._outgoing.put((GYRO, message)),
        )

    def _use_parameters(self) -> None:
        """Update the top wheel speed: 1/k1 at full duty; readings above twice that are rejected."""
        parameters = self.follower.parameters
        # A nominal file may hold the wheel radius alone.
        k1 = parameters.value("k1") if parameters is not None and parameters.has("k1") else 0.0
        self._motors.fastest_wheel = 2.0 / k1 if k1 > 0.0 else FASTEST_WHEEL


def _gyro(settings: Settings, port: SerialPort) -> tuple[SerialPort, type[Gyro]] | None:
    """Return the source of the gyro's readings and its type: its own port, or the controller's."""
    if settings.gyro_port is not None:
        gyro_type = GYROS[settings.gyro or "dsp3000"]
        return SerialPort(settings.gyro_port, settings.gyro_baud or gyro_type.baud_rate, port.host), gyro_type
    on_board = CONTROLLERS[settings.controller].gyro
    if on_board is not None and isinstance(port, StreamPort) and settings.gyro in (None, BOARD):
        return OverheardPort(port), on_board
    return None
