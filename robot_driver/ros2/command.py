"""cmr-ros2: real robots that speak ROS 2 on the bus, and virtual robots in ROS 2."""

import argparse
import re
import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from cmr.bus.message import Message
from cmr.bus.messages import now_utime
from cmr.bus.process import Process, Timer
from cmr.bus.streams import (
    COMMAND_CLAIM,
    COMMAND_OWNER,
    ESTOP,
    PARAMETERS,
    RANGE_SCAN,
    VELOCITY_COMMAND,
    WORLD_STATE,
    Stream,
)
from cmr.cli.command_line import parser
from cmr.cli.configuration import LARGEST_ROBOT_ID
from cmr.cli.errors import CommandError
from cmr.msg import process_status_t
from cmr.parameters.following import ParameterFollower
from robot_driver.ros2.bridge import RobotBridge
from robot_driver.ros2.joined import Wake, waiting_for_both
from robot_driver.ros2.network import LARGEST_DOMAIN, RANGES, choose_network
from robot_driver.ros2.options import NAMESPACE, check_base
from robot_driver.ros2.profile import Profile, ProfileError, shipped
from robot_driver.ros2.shown import ShownRobot
from robot_driver.stop_file import StopFile, state_folder

if TYPE_CHECKING:
    from robot_driver.ros2.node import Node
    from robot_driver.ros2.real import RealRobot
    from robot_driver.ros2.stage import ReplayClock, Stage

NAME = "cmr-ros2"
LEAST_RATE = 100.0  # Hz of the loop; messages on either bus are handled at once
ROBOT = re.compile(rf"(\d+)=([^@]+)(?:@({NAMESPACE}))?")
NOTHING = "Nothing to do: --robot names a real robot, --virtual and --show robots of the world, --probe looks around."
NO_ROS = (
    "cmr-ros2 needs rclpy, and {missing} cannot be imported. Source a ROS 2 (source /opt/ros/DISTRO/setup.bash) whose "
    "Python is this one, or install the extra: pip install 'calibrated-mixed-reality[ros2]'."
)

DESCRIPTION = """Let robots that speak ROS 2 take part as real robots: VELOCITY_COMMAND_N in, MOTOR_FEEDBACK_N,
GYRO_N and POSE_N out. Also publish robots of the world in ROS 2 (odometry, tf, joints, scans); virtual ones are driven
by cmd_vel.

A profile says which topic is what. The robot is sent zero when no command has come for 0.5 s, when ESTOP is engaged,
and when this process ends. If this process is killed or cut off, the robot's own timeout has to stop it: a robot
without one is refused, unless --no-base-timeout is given."""
EXAMPLE = (
    "cmr-ros2 --probe my_robot.yaml\n  cmr-ros2 --robot 0=my_robot.yaml\n"
    "  cmr-ros2 --robot 0=jackal@/j100_0042 --range subnet --domain-id 7\n  cmr-ros2 --virtual 10,11"
)


class Robot(NamedTuple):
    """A real robot: its id, its profile, and the namespace of its topics."""

    robot_id: int
    profile: str
    namespace: str


def main(arguments: list[str]) -> int:
    """Run cmr-ros2."""
    options = command_parser().parse_args(arguments)
    if options.profiles:
        return _list_profiles()
    shown = [(robot_id, True) for robot_id in options.virtual] + [(robot_id, False) for robot_id in options.show]
    if not (options.robot or shown or options.clock or options.probe):
        raise CommandError(NOTHING)
    profiles = _profiles(options.robot, [robot_id for robot_id, _ in shown], allowed=options.no_base_timeout)
    try:
        from robot_driver.ros2.node import Node
    except ImportError as error:
        raise CommandError(NO_ROS.format(missing=error.name or error)) from error
    choose_network(options.domain_id, options.range)
    if options.probe:
        from robot_driver.ros2.probe import probe

        return probe(options.probe, options.namespace or "")
    wake = Wake()
    with Process(NAME, options.lcm_url, lives_now=bool(profiles)) as process, Node("cmr", wake) as node:
        return _Work(options, profiles, shown, process, node, wake).run()


class _Work:
    """Everything between the buses."""

    def __init__(
        self,
        options: argparse.Namespace,
        profiles: dict[Robot, Profile],
        shown: list[tuple[int, bool]],
        process: Process,
        node: "Node",
        wake: Wake,
    ) -> None:
        self._process, self._node, self._wake = process, node, wake
        state = options.state or state_folder()
        self._bridges = {
            robot: RobotBridge(robot.robot_id, profile, stop_file=StopFile(state, robot.robot_id, process.bus.url))
            for robot, profile in profiles.items()
        }
        self._real: list[RealRobot] = []
        self._listened: set[tuple[str, int]] = set()
        self._stage: Stage | None = None
        self._clock: ReplayClock | None = None
        self._show(options, shown)
        self._look = Timer(1.0)
        self._rate = max([LEAST_RATE, *(profile.command.rate for profile in profiles.values())])

    def run(self) -> int:
        """Bridge until a signal arrives; return the exit code."""
        from robot_driver.ros2.real import RealRobot

        process = self._process
        process.remarks = self._remarks
        with ExitStack() as inside:
            for robot, bridge in self._bridges.items():
                inside.enter_context(bridge)
                self._real.append(RealRobot(bridge, robot.namespace, self._node, process))
                self._listen(robot.robot_id, VELOCITY_COMMAND, COMMAND_CLAIM)
            if self._bridges:
                process.subscribe(ESTOP, every=True)
            wait = waiting_for_both(process, self._wake, self._take_bus, self._take_ros)
            try:
                for utime in process.loop(self._rate, wait):
                    self._turn(utime)
            finally:
                self._leave()
        return process.exit_code

    def _show(self, options: argparse.Namespace, shown: list[tuple[int, bool]]) -> None:
        from robot_driver.ros2.stage import ReplayClock, Stage

        if shown:
            robots = []
            for robot_id, is_commanded in shown:
                has_own = (options.parameters / f"robot_{robot_id}.yaml").exists()
                source = robot_id if has_own else options.parameters_of
                follower = ParameterFollower(source, options.parameters / f"robot_{source}.yaml")
                robots.append(
                    ShownRobot(robot_id, follower, lambda: self._process.bus.sender, is_commanded=is_commanded)
                )
                self._listen(source, PARAMETERS)
                self._listen(robot_id, COMMAND_OWNER, RANGE_SCAN)
            self._stage = Stage(robots, self._node, self._process, stamped=options.stamped)
        if options.clock:
            self._clock = ReplayClock(self._node)
        if shown or options.clock:
            self._process.subscribe(WORLD_STATE, every=True)

    def _listen(self, robot_id: int, *streams: Stream[Message]) -> None:
        for stream in streams:
            if (stream.name, robot_id) not in self._listened:  # else each message would be received twice
                self._listened.add((stream.name, robot_id))
                self._process.subscribe(stream, robot_id, every=True)

    def _turn(self, utime: int) -> None:
        for bridge in self._bridges.values():
            bridge.turn()
        self._take_bus()
        for real in self._real:
            real.publish_if_due(utime)
            self._process.publish_all(real.bridge.reports())
            for news in real.bridge.news():
                self._process.news(news)
        if self._stage is not None:
            self._stage.turn(utime)
        if self._look.due():
            for real in self._real:
                real.look()
        self._report(utime)

    def _take_bus(self) -> None:
        """Handle the messages of the bus; send changed commands at once."""
        self._process.dispatch_named(self._handle)

    def _handle(self, utime: int, channel: str, message: Message, sender: int | None) -> None:
        for real in self._real:
            if real.bridge.handle(utime, channel, message, sender):
                real.publish(now_utime())
        for other in (self._stage, self._clock):
            if other is not None:
                other.handle(utime, channel, message)

    def _take_ros(self) -> None:
        """Handle the messages of ROS 2."""
        for take, message, arrival in self._node.arrived():
            take(message, arrival)

    def _leave(self) -> None:
        from robot_driver.ros2.real import BETWEEN_ZEROS, LAST_ZEROS

        if self._stage is not None:
            self._stage.leave(now_utime())
        unheard: list[int] = []
        for _ in range(LAST_ZEROS if self._real else 0):
            unheard = [real.bridge.robot_id for real in self._real if not real.stop(now_utime())]
            time.sleep(BETWEEN_ZEROS)
        if self._real:
            missing = ", ".join(map(str, unheard))
            self._process.farewell = f"no node took zero for robot {missing}" if unheard else "zero sent"

    def _report(self, utime: int) -> None:
        """Update the next PROCESS_STATUS; publish at once when something was lost or came back."""
        process = self._process
        problems = [real.bridge.problems() for real in self._real]
        problems += [self._stage.problem(utime)] if self._stage is not None else []
        problem = " ".join(filter(None, problems))
        before, process.state = process.state, process_status_t.DEGRADED if problem else process_status_t.RUNNING
        process.message = problem
        if process.state != before:
            process.publish_status()

    def _remarks(self) -> str:
        remarks = [real.bridge.remarks() for real in self._real] + [self._stage.remark if self._stage else ""]
        if self._node.lost:
            remarks.append(f"Messages of ROS 2 that waited too long: {self._node.lost}.")
        return " ".join(filter(None, remarks))


def command_parser() -> argparse.ArgumentParser:
    """Return the command line of cmr-ros2."""
    options = parser(NAME, DESCRIPTION, EXAMPLE)
    options.add_argument(
        "--robot",
        type=_robot,
        action="append",
        default=[],
        metavar="N=PROFILE[@/NAMESPACE]",
        help="a real robot: its id, its profile (a file, or the name of one that CMR ships), and the namespace of its "
        "topics; may be given several times",
    )
    options.add_argument("--profiles", action="store_true", help="list the profiles that CMR ships, and end")
    options.add_argument(
        "--no-base-timeout",
        action="store_true",
        help="also drive a robot that does not stop by itself: it keeps driving if this process is killed or cut off",
    )
    options.add_argument(
        "--virtual", type=_ids, default=[], metavar="N,N,...", help="publish these robots, and drive them by cmd_vel"
    )
    options.add_argument(
        "--show", type=_ids, default=[], metavar="N,N,...", help="publish these robots, without cmd_vel"
    )
    options.add_argument(
        "--stamped", action="store_true", help="cmd_vel of virtual robots is a TwistStamped, not a Twist"
    )
    options.add_argument(
        "--parameters", type=Path, default=Path(), metavar="DIR", help="folder of robot_N.yaml of robots that are shown"
    )
    options.add_argument(
        "--parameters-of", type=int, default=0, metavar="N", help="robot whose parameters those without a file have"
    )
    options.add_argument(
        "--clock", action="store_true", help="publish /clock by the time of WORLD_STATE, for a log that is replayed"
    )
    _add_network(options)
    return options


def _add_network(options: argparse.ArgumentParser) -> None:
    options.add_argument(
        "--probe", type=Path, metavar="FILE", help="list the topics there are, write a profile, and end"
    )
    options.add_argument(
        "--namespace", metavar="/NAME", help="with --probe: namespace of the robot's topics (default: all)"
    )
    options.add_argument("--domain-id", type=_domain, metavar="N", help="ROS domain (default: ROS_DOMAIN_ID, else 0)")
    options.add_argument(
        "--range",
        choices=RANGES,
        default=RANGES[0],
        help="how far ROS 2 looks for other nodes (default: this computer)",
    )
    options.add_argument("--state", type=Path, metavar="DIR", help="folder in which emergency stops are kept")


def _profiles(robots: Sequence[Robot], shown: Sequence[int], *, allowed: bool) -> dict[Robot, Profile]:
    """Return the profiles of real robots. Raises CommandError for robots that must not or cannot be driven."""
    ids = [robot.robot_id for robot in robots] + list(shown)
    twice = sorted({robot_id for robot_id in ids if ids.count(robot_id) > 1})
    if twice:
        raise CommandError(f"Robot {twice[0]} is named twice.")
    try:
        profiles = {robot: Profile.load(robot.profile) for robot in robots}
        for profile in profiles.values():
            check_base(profile, allowed=allowed)
    except ProfileError as error:
        raise CommandError(str(error)) from error
    return profiles


def _list_profiles() -> int:
    for name in shipped():
        profile = Profile.load(name)
        timeout = profile.base.command_timeout
        stops = "no command timeout" if timeout is None else f"command timeout {timeout:g} s"
        tried = profile.tried or "never tried on a real robot"
        print(f"{name:14} {profile.name}; {stops}; {tried}")
    return 0


def _robot(text: str) -> Robot:
    match = ROBOT.fullmatch(text)
    if match is None or int(match[1]) > LARGEST_ROBOT_ID:
        raise argparse.ArgumentTypeError(f"{text!r} is not like 0=turtlebot3 or 1=my_robot.yaml@/tb3_1")
    return Robot(int(match[1]), match[2], (match[3] or "").rstrip("/"))


def _ids(text: str) -> list[int]:
    parts = [part.strip() for part in text.split(",")]
    if not all(part.isascii() and part.isdecimal() and int(part) <= LARGEST_ROBOT_ID for part in parts):
        raise argparse.ArgumentTypeError(f"{text!r} is not a list of robot ids, such as 10,11")
    return [int(part) for part in parts]


def _domain(text: str) -> int:
    if not (text.isascii() and text.isdecimal() and int(text) <= LARGEST_DOMAIN):
        raise argparse.ArgumentTypeError(f"{text!r} is not a domain from 0 to {LARGEST_DOMAIN}")
    return int(text)
