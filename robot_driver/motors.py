"""The motor controller of one robot, in the thread of its port: drive, measure, report."""

import math
import queue
import sys
import threading
from collections.abc import Callable
from dataclasses import dataclass, replace

from cmr.model.duty_ramp import Limits, Ramp
from cmr.msg import motor_duty_t, motor_feedback_t
from robot_driver.asking import Asking
from robot_driver.battery import Thresholds
from robot_driver.command_gate import CommandGate, Drive
from robot_driver.controllers import BadReply, Controller, Request, Telemetry
from robot_driver.encoders import FASTEST_WHEEL, CountersReset, WheelEncoders, Wiring
from robot_driver.feedback import Feedback, SentDuties, SentDuty
from robot_driver.health import Health
from robot_driver.port_thread import Device
from robot_driver.rhythm import Rhythm
from robot_driver.serial_port import NotSent, PortLost, SerialPort

SILENCE_LIMIT = 0.4  # s without an acknowledged duty after which the device counts as gone, perhaps switched off
HUSH = 0.1  # s without one after which the device may have been reset: check it before driving on
BLIND_LIMIT = 1.0  # s without encoder counts after which the connection is made again, though duties are acknowledged
DUTY_LIFETIME = 0.1  # s after which a duty not sent yet is out of date
TAKEN_FOR_ZERO = 0.002  # duty that a controller may round to zero
SILENCE_OF_OURS = 0.1  # s by which the driver's silence exceeds the device's watchdog
PROMPT = 3_000_000  # ns; an answer that arrives sooner was not delayed by an adapter
SLOWEST_ADAPTER, PROBES = 0.016, 16  # longest delay of an adapter (s); number of requests within that time
ARM_ATTEMPTS = 10  # attempts; without an answer, the motors are held until the next connection
STANDING = 1.0  # s of zero duty after which the robot counts as stationary
STOPPING = 0.5  # s for the attempts to send the last zero, so that the process ends within a second
TELEMETRY_ATTEMPTS = 5  # after each connection; firmware does not answer unknown requests


@dataclass
class _Connection:
    """State of one connection."""

    controller: Controller
    unarmed: str  # why the motors must not turn; "" if they may
    requests: list[Request[Telemetry]]  # the telemetry that this device has
    turn: int = 0


class Motors(Device):
    """Drives two motors through a controller at a steady rate and publishes a motor_feedback_t each time.

    `publish_duty` takes a motor_duty_t for each duty that was sent but is in no feedback.

    The command is read from `gate` immediately before it is sent: whatever other threads do, an old command is never
    sent. `fastest_wheel` (rad/s) may be set at any time. `rhythm` measures how regularly the motors are served and how
    soon the device answers. `news` are sentences on what happened, `stopped` whether zero was acknowledged at the end.
    """

    def __init__(
        self,
        port: SerialPort,
        controller_type: type[Controller],
        gate: CommandGate,
        *,
        robot_id: int,
        rate_hz: float,
        ticks_per_turn: int,
        wiring: Wiring,
        limits: Limits,
        thresholds: Thresholds,
        publish: Callable[[motor_feedback_t], None],
        publish_duty: Callable[[motor_duty_t], None],
    ) -> None:
        self.fastest_wheel = FASTEST_WHEEL
        self.rhythm = Rhythm(port.host.monotonic)
        self.news: queue.SimpleQueue[str] = queue.SimpleQueue()
        self.stopped = False  # zero was acknowledged when the device was left
        self._moved = -math.inf  # when a duty other than zero was last acknowledged (s)
        self._driving = False
        self._asking = Asking(port, controller_type, self.rhythm)
        self._port = port
        self._host = port.host
        self._controller_type = controller_type
        self._gate = gate
        self._period = 1.0 / rate_hz
        self._encoders = WheelEncoders(ticks_per_turn)
        self._wiring = wiring
        self._ramp = Ramp(limits, longest_step=2 * self._period)
        self._health = Health(gate, thresholds, controller_type.essential, port.path, self._period)
        self._feedback = Feedback(robot_id, wiring, port.host.utime_at)
        self._publish = publish
        self._sent = SentDuties(robot_id, publish_duty)
        self._connection: _Connection | None = None
        self._last_driven = 0.0
        self._last_counted = 0.0
        self._refusal = ""  # why this device must not be driven, whatever connection is made
        self._strays = 0  # of the port, before the last request to drive
        self._due = 0.0

    @property
    def faults(self) -> int:
        """Number of requests with no answer or a wrong one."""
        return self._asking.faults

    @property
    def jumps(self) -> int:
        """Number of rejected encoder steps."""
        return self._encoders.jumps

    def connect(self, stop: threading.Event) -> None:
        """Stop the motors, identify the device, arm it; after that, a new command is needed."""
        controller = self._new_controller()
        self._port.resynchronise()
        self._asking.insist(controller.drive(0.0, 0.0), stop)
        name = self._asking.insist(controller.identify(), stop)
        for request in controller.learn():
            self._asking.insist(request, stop)
        self._learn_turnaround(controller, stop)
        unarmed = self._arm(controller, stop)
        self._asking.insist(controller.read_encoders(), stop)  # without them the wheels' motion would be unknown
        # Arming may have taken so long that the board fell silent.
        self._asking.insist(controller.drive(0.0, 0.0), stop)
        self._connection = _Connection(controller, self._refusal or unarmed, self._first_readings(controller, stop))
        self._act(self._connection)
        self._gate.clear()
        self._ramp.reset()
        self.news.put(f"connected to {name or 'the controller'} at {self._port.path}, {1.0 / self._period:g} Hz")
        self._due = self._last_driven = self._last_counted = self._host.monotonic()

    def turn(self, stop: threading.Event) -> None:
        """Send the duty, read the encoders, and one slow reading; if all are answered, wait for the next cycle."""
        assert self._connection is not None
        self.rhythm.note_turn()
        try:
            if self._host.monotonic() - self._last_driven > HUSH:
                self._look(self._connection)
            self._serve(self._connection)
        except BadReply:
            self._asking.recover()
            # Try again at once: at a low rate, it would take too long to find the cause.
            self._due = min(self._due, self._host.monotonic() - self._period)
        except CountersReset as reset:
            raise PortLost(self._asking.reset("its encoder counts restarted at zero")) from reset
        self._refusal = self._refusal or self._connection.controller.objection
        if self._host.monotonic() - self._last_driven > SILENCE_LIMIT:
            raise PortLost(self._asking.silence())
        if self._host.monotonic() - self._last_counted > BLIND_LIMIT:
            raise PortLost(f"The controller at {self._port.path} takes duties, but reports no encoder counts.")
        self._due = max(self._due + self._period, self._host.monotonic() - self._period)
        stop.wait(max(self._due - self._host.monotonic(), 0.0))

    def leave(self) -> None:
        """Stop the motors, with an acknowledgement.

        Without one, further requests may feed the device's watchdog although it understands none of them: then leave
        the device alone until the watchdog stops the motors.
        """
        controller = self._connection.controller if self._connection else self._new_controller()
        self._connection = None
        self.rest = 0.0
        self.rhythm.pause()
        give_up = self._host.monotonic() + STOPPING
        # The first acknowledgement may belong to another duty. Unacknowledged stops are repeated in the next round.
        wanted = controller.stops() * (2 if self._asking.doubtful else 1)
        while wanted and self._host.monotonic() < give_up:
            request = wanted.pop(0)
            try:
                self._port.exchange(request)
            except BadReply:
                self._asking.recover()
                wanted.append(request)
        self.stopped = not wanted
        if wanted:
            self.rest = controller.watchdog_seconds + SILENCE_OF_OURS

    def _new_controller(self) -> Controller:
        controller = self._controller_type()
        controller.monotonic_ns = self._host.monotonic_ns
        return controller

    def _learn_turnaround(self, controller: Controller, stop: threading.Event) -> None:
        """Measure the device's fastest answer through a USB adapter that collects bytes before it passes them on.

        Such an adapter delivers at fixed intervals. A request that is sent right after a delivery always waits for a
        whole interval. Requests are therefore sent with delays spread over the longest interval: one of the answers
        reaches the adapter just before it delivers, and that one shows how fast the device is.
        """
        if PROMPT < self._port.turnaround < sys.maxsize:
            for number in range(PROBES):
                stop.wait(SLOWEST_ADAPTER * number / PROBES)
                self._asking.insist(controller.read_encoders(), stop)

    def _count_on(self, controller: Controller, stop: threading.Event) -> None:
        """Decide whether tick counts continue: a device that still has its watchdog was not reset, so they do.

        A device whose watchdog is built in does not show whether it was reset. Raises PortLost.
        """
        if not controller.set_watchdog(controller.watchdog_seconds).data:
            self._encoders.doubt()
        elif not _is_set(controller, self._asking.insist(controller.read_watchdog(), stop, ARM_ATTEMPTS)):
            self._encoders.rebase()

    def _arm(self, controller: Controller, stop: threading.Event) -> str:
        """Set the device's own watchdog and read it back; return why the motors must be held, or ""."""
        try:
            self._count_on(controller, stop)
            self._asking.insist(controller.set_watchdog(controller.watchdog_seconds), stop, ARM_ATTEMPTS)
            seconds = self._asking.insist(controller.read_watchdog(), stop, ARM_ATTEMPTS)
        except PortLost as lost:
            if not self._asking.answers(controller):
                raise
            self._encoders.rebase()
            return f"Not driving: the controller at {self._port.path} does not let its watchdog be set ({lost})."
        if _is_set(controller, seconds):
            return ""
        return (
            f"Not driving: the watchdog of the controller at {self._port.path} was set to "
            f"{controller.watchdog_seconds:g} s but reads {seconds:g} s, so nothing would stop the motors if this "
            f"computer failed. Check its firmware."
        )

    def _first_readings(self, controller: Controller, stop: threading.Event) -> list[Request[Telemetry]]:
        """Make all requests for telemetry before anything moves; return those to make in turn from now on.

        Requests that this device does not answer are dropped, unless an essential quantity is missing.
        """
        requests = controller.read_telemetry()
        self._health.begin(len(requests))
        answered = []
        for request in requests:
            try:
                answer = self._asking.insist(request, stop, TELEMETRY_ATTEMPTS)
            except PortLost:
                if stop.is_set() or not self._asking.answers(controller):
                    raise
                continue
            self._health.take(request, answer, self._host.monotonic())
            answered.append(request)
        return requests if self._health.missing(self._host.monotonic()) else answered

    def _look(self, connection: _Connection) -> None:
        """Check that the device, which may have been reset, is still armed.

        While there is no answer, only zero may be sent, and it is: one of two units may still receive, and drive on. At
        a low rate this happens in every cycle; there, one lost answer does not count as silence. Raises BadReply if
        there is no answer.
        """
        was_silent = self._asking.doubtful
        try:
            self._check_watchdog(connection)
        except BadReply:
            self._asking.recover()
            if not was_silent:
                self._look(connection)
                return
            self._ramp.reset()
            self._asking.ask(connection.controller.drive(0.0, 0.0))
            self._check_watchdog(connection)

    def _serve(self, connection: _Connection) -> None:
        """Make the requests of one cycle.

        An acknowledgement may be a single byte that other answers begin with, too: if anything follows it, a damaged
        request was taken for another one, and the duty is not in force. All acknowledgements look alike, so after a
        missing answer the next one may be late. A reading that was not requested lately is distinguishable from
        everything else: late bytes come before it, or damage it. Only then is it certain which duty is in force.
        """
        applied, status = self._drive(connection)
        was_doubtful = self._asking.doubtful
        if was_doubtful:
            self._read_telemetry(connection)
            self._asking.doubtful = False
            applied, status = self._drive(connection)
        self._read_encoders(connection, applied, status)
        self._ramp.confirm()
        if not was_doubtful:
            self._read_telemetry(connection)

    def _drive(self, connection: _Connection) -> tuple[SentDuty, int]:
        """Send the duty in force; return the acknowledged duty and the corresponding status."""
        connection.unarmed = self._refusal or connection.unarmed
        self._act(connection)
        self._strays = self._port.strays
        self._port.discard_strays()  # it takes a while, after which the command may have changed
        now = self._host.seconds_since_boot()
        drive = self._gate.drive(now)
        if connection.unarmed:
            drive = Drive(0.0, 0.0, drive.status | motor_feedback_t.STATUS_NOT_ARMED)
        if drive.status:  # no ramp: stop at once
            self._ramp.reset()
            duties = 0.0, 0.0
        else:
            duties = self._ramp.towards(drive.left, drive.right, now)
        request = connection.controller.drive(*self._wiring.channels(*duties))
        if any(duties):  # zero is never too late
            request = replace(request, not_after=now + DUTY_LIFETIME)
        sent = self._host.utime_at(self._host.monotonic_ns())
        try:
            answer = self._asking.ask(request)
        except BadReply as failed:
            if not isinstance(failed, NotSent):
                self._sent.add(SentDuty(*duties, sent))
            raise
        acknowledged = answer.value
        self._last_driven = self._host.monotonic()
        self._note_driving(any(acknowledged))
        if max(map(abs, duties)) > TAKEN_FOR_ZERO and not any(acknowledged):
            self._ramp.reset()  # the controller holds the motors itself: on release they start from zero
        else:
            self._ramp.acknowledge()
        applied = SentDuty(*self._wiring.forward(*acknowledged), self._host.utime_at(answer.measured))
        self._sent.add(applied)
        return applied, drive.status

    def _note_driving(self, moving: bool) -> None:
        """Report when the motors begin to drive, and when they have been at zero for a while."""
        now = self._host.monotonic()
        self._moved = now if moving else self._moved
        if self._driving != (now - self._moved < STANDING):
            self._driving = not self._driving
            self.news.put("driving" if self._driving else "standing")

    def _read_encoders(self, connection: _Connection, applied: SentDuty, status: int) -> None:
        answer = self._asking.ask(connection.controller.read_encoders())
        self._last_counted = self._host.monotonic()
        if self._port.strays != self._strays:
            raise BadReply("More than an acknowledgement was answered to a duty.")
        counts = self._wiring.forward_counts(*answer.value)
        motion = self._encoders.update(counts, answer.measured, self.fastest_wheel)
        if motion is not None:
            self._sent.publish_all_but(applied)
            telemetry = self._health.recent(self._host.monotonic())
            self._publish(self._feedback.message(answer, motion, self.jumps, applied, telemetry, status))

    def _read_telemetry(self, connection: _Connection) -> None:
        """Make the next of the slow requests."""
        connection.turn += 1
        slot = connection.turn % (len(connection.requests) + 1)
        if slot == len(connection.requests):
            self._check_watchdog(connection)
            return
        request = connection.requests[slot]
        answer = self._asking.ask(request).value
        self._health.take(request, answer, self._host.monotonic())

    def _check_watchdog(self, connection: _Connection) -> None:
        """Check the device's watchdog: a device that was reset meanwhile has none.

        Raises PortLost, so that the connection is made again.
        """
        if connection.unarmed:
            return
        controller = connection.controller
        seconds = self._asking.ask(controller.read_watchdog()).value
        if not _is_set(controller, seconds):
            raise PortLost(
                self._asking.reset(f"its watchdog reads {seconds:g} s instead of {controller.watchdog_seconds:g} s")
            )

    def _act(self, connection: _Connection) -> None:
        """Hold or release the motors by the controller's readings, including missing ones, and report problems."""
        health = self._health.act(self._host.monotonic())
        self.problem = " ".join(filter(None, (connection.unarmed, health)))


def _is_set(controller: Controller, seconds: float) -> bool:
    """Return whether this is the requested watchdog time."""
    return math.isclose(seconds, controller.watchdog_seconds, abs_tol=1e-6)
