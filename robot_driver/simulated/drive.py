"""The log of a whole drive in simulated time: pilot, driver, bytes, controller, plant, encoders and gyro, and back."""

import math
import threading
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from datetime import datetime, timezone
from pathlib import Path
from random import Random

from cmr.bus.messages import make
from cmr.bus.streams import GYRO, MOTOR_COMMAND, MOTOR_FEEDBACK, PARAMETERS, POSE, WORLD_STATE
from cmr.msg import gyro_t, motor_command_t, parameters_t, pose_xyt_t
from cmr.parameters.file import ParameterFile, Value
from cmr.parameters.following import ParameterFollower
from cmr.world.behaviours import Behaviour, make_behaviour
from cmr.world.estimator import Estimator
from cmr.world.pilot import Pilot
from cmr.world.view import REAL, Robot, world_messages
from robot_driver import driver
from robot_driver.emulator.device import Device
from robot_driver.emulator.devices import CONTROLLER_DEVICES, GYRO_DEVICES
from robot_driver.emulator.faults import Faults, FaultyLine
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.robot_in_time import RobotInTime
from robot_driver.emulator.sensors import MotionCapture, Pose
from robot_driver.emulator.settings import Settings, load_settings
from robot_driver.settings import Settings as DriverSettings
from robot_driver.simulated.bus import Inbox, SimulatedBus, taken
from robot_driver.simulated.host import START_UTIME, SimulatedHost
from robot_driver.simulated.usb import Lateness, OwnUsb, UsbAdapter

DRIVER_RATE, PILOT_RATE = 200.0, 50.0  # Hz
MOTOR, GYRO_PORT = "motor", "gyro"
ENDING = 2.0  # s that the threads are given to end
OWN_USB = {"mbot"}  # boards that no adapter stands before


@dataclass(frozen=True)
class SimulatedDrive:
    """What is driven, and by what; names as on the command lines of cmr-driver, cmr-emulate and cmr-pilot.

    `behaviour` may be one that is made already, which has no `behaviour_settings`; then `on_second` is called each
    second, and the drive ends when the behaviour does.

    `believed` are the parameters that the pilot steers by; by default the true wheel radius, k2_over_k3, k1 and base
    width. Lost and damaged bytes follow `faults`. `gyro` None: that of the board, or none. `wired` are the settings of
    cmr-driver, by default those of a robot that is wired as it should be.
    """

    settings: Settings = field(default_factory=load_settings)
    controller: str = "roboclaw"
    gyro: str | None = "dsp3000"
    behaviour: str | Behaviour = "figure_eight"
    behaviour_settings: Mapping[str, str] = field(default_factory=lambda: {"size": "1.15", "laps": "3", "start": "1"})
    seconds: float = 60.0
    pose_rate: float = 50.0
    seed: int = 0
    lateness: Lateness = field(default_factory=Lateness)
    faults: Faults = field(default_factory=Faults)
    believed: ParameterFile | None = None
    robot_id: int = 0
    on_second: Callable[[], object] = lambda: None
    wired: DriverSettings | None = None

    def write_log(self, path: Path) -> None:
        """Drive, and write all messages to an LCM event log: the same bytes each time.

        Raises PortLost where the driver finds no ports, and whatever ended one of its threads.
        """
        host = SimulatedHost(self.seed, self.lateness)
        with SimulatedBus(path, host) as bus:
            self._plug_in(host, bus)
            bus.publish(PARAMETERS, self._announcement(), self.robot_id)
            done = host.event()
            threads = [
                host.thread(lambda: self._drive(host, bus, done), "cmr-driver"),
                host.thread(lambda: self._steer(host, bus, done), "cmr-pilot"),
            ]
            for thread in threads:
                thread.start()
            self._let_drive(host)
            done.set()
            for thread in threads:
                thread.join(ENDING)
            host.check()

    def _let_drive(self, host: SimulatedHost) -> None:
        """Let time go on; with a behaviour that was made before, until that is over and the robot rests."""
        if isinstance(self.behaviour, str):
            host.run(self.seconds)
            return
        for _ in range(math.ceil(self.seconds)):
            over = self.behaviour.finished
            host.run(1.0)
            self.on_second()
            if over:
                break

    def _plug_in(self, host: SimulatedHost, bus: SimulatedBus) -> None:
        """Make the robot and plug it in."""
        plant = Plant(self.settings)
        devices: dict[str, Device] = {MOTOR: CONTROLLER_DEVICES[self.controller](self.settings, plant)}
        if self.gyro is not None:
            devices[GYRO_PORT] = GYRO_DEVICES[self.gyro](self.settings, plant)
        adapters: dict[str, UsbAdapter | OwnUsb] = {}
        for name in devices:
            own_usb = not self.lateness.usb_latency or (name == MOTOR and self.controller in OWN_USB)
            random = Random(f"{self.seed} adapter {name}")
            adapters[name] = OwnUsb() if own_usb else UsbAdapter(self.lateness.usb_latency, random)
        if self.faults != Faults():
            devices = {name: FaultyLine(device, self.faults, self.seed) for name, device in devices.items()}

        def publish(pose: Pose) -> None:
            host.follow_robot()
            message = make(
                pose_xyt_t,
                utime=host.utime_of_robot(pose.time),
                robot_id=self.robot_id,
                x=pose.x,
                y=pose.y,
                theta=pose.theta,
            )
            bus.publish(POSE, message, self.robot_id)

        capture = MotionCapture(self.settings, plant, self.pose_rate)
        robot = RobotInTime(plant, devices, host.arrive, adapters=adapters, motion_capture=capture, on_pose=publish)
        host.plug_in(robot, adapters)

    def _announcement(self) -> parameters_t:
        robot = self.settings.robot
        names = ("wheel_radius", "k2_over_k3", "k1", "base_width")
        values = {name: Value(getattr(robot, name)) for name in names}
        true = ParameterFile(self.robot_id, values, written=datetime.fromtimestamp(START_UTIME // 10**6, timezone.utc))
        result: parameters_t = (self.believed or true).announcement(START_UTIME)
        result.utime = START_UTIME
        return result

    def _drive(self, host: SimulatedHost, bus: SimulatedBus, done: threading.Event) -> None:
        """Be cmr-driver."""
        settings = self.wired or DriverSettings(
            port=MOTOR,
            gyro_port=GYRO_PORT if self.gyro is not None else None,
            gyro=self.gyro,
            robot=self.robot_id,
            controller=self.controller,
            ticks_per_turn=round(self.settings.robot.ticks_per_turn),
        )
        inbox = bus.subscribe(MOTOR_COMMAND.channel(self.robot_id), PARAMETERS.channel(self.robot_id))
        with driver.Driver(settings, host) as running:
            for _ in steadily(host, DRIVER_RATE, done):
                running.turn()
                for channel, message in taken(inbox):
                    running.handle(message.utime, channel, message)
                for stream, robot_id, message in running.outgoing():
                    bus.publish(stream, message, robot_id or 0)
                running.problems()

    def _steer(self, host: SimulatedHost, bus: SimulatedBus, done: threading.Event) -> None:
        """Be cmr-pilot, and what of cmr-sim it needs: the estimate of the robot."""
        given = self.behaviour
        behaviour = make_behaviour(given, self.behaviour_settings) if isinstance(given, str) else given
        pilot = Pilot(self.robot_id, behaviour, ParameterFollower(self.robot_id), keep_clear=False)
        announcement = self._announcement()
        pilot.handle(announcement.utime, PARAMETERS.channel(self.robot_id), announcement)
        pilot.prepare()
        estimator = Estimator(self.robot_id)
        parameters = pilot.parameters.parameters
        estimator.parameters = parameters.robot_parameters if parameters else None
        inbox = bus.subscribe(*(stream.channel(self.robot_id) for stream in (MOTOR_FEEDBACK, GYRO, POSE)))
        for utime in steadily(host, PILOT_RATE, done):
            for channel, message in without_superseded_rates(taken(inbox)):
                estimator.handle(message.utime, channel, message)
                pilot.handle(message.utime, channel, message)
            me = Robot(estimator.utime, self.robot_id, REAL, estimator.state)
            for world in world_messages(me.utime, [me]) if estimator.known else ():
                pilot.handle(world.utime, WORLD_STATE.name, world)
            bus.publish(MOTOR_COMMAND, pilot.command(utime), self.robot_id)
            for stream, message in pilot.tell(utime):
                bus.publish(stream, message, self.robot_id)
            if isinstance(behaviour, Behaviour) and behaviour.finished:
                break
        stop = make(motor_command_t, utime=host.utime(), robot_id=self.robot_id, left=0.0, right=0.0)
        bus.publish(MOTOR_COMMAND, stop, self.robot_id)


def without_superseded_rates(messages: Inbox) -> Inbox:
    """Return the messages without those of the gyro that another one follows: an estimate takes the newest rate."""
    kept: Inbox = []
    for channel, message in messages:
        if kept and kept[-1][0] == channel and isinstance(message, gyro_t) and message.valid:
            kept.pop()
        kept.append((channel, message))
    return kept


def steadily(host: SimulatedHost, rate: float, done: threading.Event) -> Iterator[int]:
    """Yield the time of day (us) so many times a second, until it is `done`."""
    due = host.monotonic()
    while not done.is_set():
        yield host.utime()
        due = max(due + 1.0 / rate, host.monotonic())
        done.wait(due - host.monotonic())
