"""cmr-emulate: an emulated robot behind real serial ports, or with a velocity controller on the bus."""

import signal
import tempfile
from argparse import ArgumentParser, Namespace
from collections.abc import Mapping
from pathlib import Path

from cmr.bus.messages import make
from cmr.bus.process import EXIT_INTERRUPTED, Process
from cmr.bus.streams import COMMAND_CLAIM, COMMAND_OWNER, ESTOP, ESTOP_LATCH, POSE
from cmr.cli.command_line import add_robot, parser
from cmr.cli.errors import CommandError
from cmr.cli.options import add_options, made_of
from cmr.model.command_kinds import DUTY
from cmr.msg import pose_xyt_t
from cmr.plain_text import plain
from cmr.priority import go_first
from robot_driver.emulator.device import Device, not_understood
from robot_driver.emulator.devices import CONTROLLER_DEVICES, GYRO_DEVICES
from robot_driver.emulator.engine import Engine
from robot_driver.emulator.hand_device import HandDevice
from robot_driver.emulator.options import Emulation
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.sensors import MotionCapture, Pose
from robot_driver.emulator.settings import Settings, SettingsError, load_settings
from robot_driver.emulator.speed_robot import COMMANDS, SpeedRobot
from robot_driver.terminals.pseudo_terminal import DEFAULT_FOLDER, Ports, PortsError

LOOP_RATE = 200.0  # Hz; a measurement is published within 5 ms, with the time at which it was made
HANDS = "hands"
CHECK_PERIOD = 0.2  # s between checks whether the emulated robot still runs
MOST_NAMED = 10  # kinds of input not understood
SIGNALS = (signal.SIGINT, signal.SIGTERM)


def main(arguments: list[str]) -> int:
    """Emulate a robot until a signal arrives; return the exit code.

    Raises CommandError if settings or ports cannot be used, BusError if there is no bus.
    """
    options, emulation = _options(arguments)
    try:
        settings = load_settings(emulation.settings, seed=options.seed, ideal=emulation.ideal)
        if emulation.command != DUTY:
            return _run_speed_robot(options, settings)
        names = ("motor", "gyro", HANDS) if options.hands else ("motor", "gyro")
        ports = Ports(Path(options.ports or _default_folder(options.robot)), names)
        if options.no_pose:
            return _run_without_bus(options, settings, ports)
        return _run_on_bus(options, settings, ports)
    except (SettingsError, PortsError) as error:
        raise CommandError(str(error)) from error


def command_parser() -> ArgumentParser:
    """Return the command line of cmr-emulate."""
    options = parser(
        "cmr-emulate",
        "Emulate a robot: motor controller and gyro on pseudo-terminals, physics with friction, slip and noise behind "
        "them, and its pose on POSE_N as motion capture would publish it.\n\n"
        "With --command velocity or wheel_speed the robot has a velocity controller inside, as most bought robots do. "
        "It has no ports and needs no cmr-driver: it takes VELOCITY_COMMAND_N or WHEEL_SPEED_COMMAND_N itself and "
        "publishes MOTOR_FEEDBACK_N and GYRO_N.",
        "cmr-emulate --ports /tmp/robot --ideal\n  cmr-driver --port /tmp/robot/motor --gyro-port /tmp/robot/gyro\n\n"
        "  cmr-emulate --command velocity --ideal",
    )
    add_robot(options)
    add_options(options, Emulation)
    options.add_argument("--seed", type=int, metavar="N", help="of all random numbers, instead of that of the settings")
    options.add_argument("--ports", type=Path, metavar="DIR", help=f"folder for the ports; else {_default_folder(0)}")
    options.add_argument(
        "--hands",
        action="store_true",
        help="a third port, hands: lines written to it lift the robot and turn its wheels or itself, as for cmr "
        "bringup: lift, lower, left 10, right 10, robot 1, look",
    )
    options.add_argument("--no-pose", action="store_true", help="no external pose; no bus is needed then")
    return options


def _options(arguments: list[str]) -> tuple[Namespace, Emulation]:
    parser = command_parser()
    options = parser.parse_args(arguments)
    try:
        return options, made_of(Emulation, options)
    except ValueError as error:
        parser.error(str(error))


def _default_folder(robot_id: int) -> Path:
    return Path(tempfile.gettempdir()) / f"{DEFAULT_FOLDER}{robot_id}"


def _devices(options: Namespace, settings: Settings, plant: Plant) -> dict[str, Device]:
    """Return the device at each port."""
    controller, gyro = CONTROLLER_DEVICES[options.controller], GYRO_DEVICES[options.gyro]
    devices = {"motor": controller(settings, plant), "gyro": gyro(settings, plant)}
    return {**devices, HANDS: HandDevice(settings, plant)} if options.hands else devices


def _run_on_bus(options: Namespace, settings: Settings, ports: Ports) -> int:
    def publish(pose: Pose) -> None:
        utime = engine.utime(pose.time)
        message = make(pose_xyt_t, utime=utime, robot_id=options.robot, x=pose.x, y=pose.y, theta=pose.theta)
        process.publish(POSE, message, options.robot)

    plant = Plant(settings)
    capture = MotionCapture(settings, plant, options.pose_rate)
    with Process("cmr-emulate", options.lcm_url) as process, ports:
        devices = _devices(options, settings, plant)
        engine = Engine(plant, devices, ports.terminals, motion_capture=capture, on_pose=publish)
        with engine:
            _announce(options.robot, ports)
            for _ in process.loop(1.0 / CHECK_PERIOD):
                engine.check()
        _name_what_was_not_understood(devices)
    return process.exit_code


def _run_speed_robot(options: Namespace, settings: Settings) -> int:
    with Process("cmr-emulate", options.lcm_url) as process:
        takes = COMMANDS[options.command]
        robot = SpeedRobot(settings, options.robot, options.command, None if options.no_pose else options.pose_rate)
        process.subscribe(takes, options.robot, every=True)
        process.subscribe(COMMAND_CLAIM, options.robot, every=True)
        process.subscribe(ESTOP, every=True)
        print(f"cmr-emulate: robot {options.robot} is ready: it takes {takes.channel(options.robot)}", flush=True)
        go_first()
        process.remarks = robot.remarks
        for _ in process.loop(LOOP_RATE):
            robot.turn()
            process.dispatch_named(robot.handle)
            process.publish_all(robot.outgoing())
            process.publish_all((COMMAND_OWNER, options.robot, report) for report in robot.owner_reports())
            process.publish_all((ESTOP_LATCH, options.robot, report) for report in robot.stop_reports())
    return process.exit_code


def _run_without_bus(options: Namespace, settings: Settings, ports: Ports) -> int:
    plant = Plant(settings)
    # Blocked signals stay pending until they are polled, also while the ports are created and removed.
    signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    devices = _devices(options, settings, plant)
    with ports, Engine(plant, devices, ports.terminals) as engine:
        _announce(options.robot, ports)
        while signal.sigtimedwait(SIGNALS, CHECK_PERIOD) is None:
            engine.check()
    _name_what_was_not_understood(devices)
    return EXIT_INTERRUPTED


def _name_what_was_not_understood(devices: Mapping[str, Device]) -> None:
    """Print the input of clients that devices did not understand, the most frequent first."""
    for port, device in devices.items():
        counted = not_understood(device).most_common(MOST_NAMED)
        if counted:
            named = plain(", ".join(f"{what} ({count})" for what, count in counted))
            print(f"cmr-emulate: not understood on port {port}: {named}", flush=True)


def _announce(robot_id: int, ports: Ports) -> None:
    paths = " ".join(f"{name} {path}" for name, path in ports.paths.items())
    print(f"cmr-emulate: robot {robot_id} is ready: {paths}", flush=True)
