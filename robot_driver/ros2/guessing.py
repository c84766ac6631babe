"""Draft a profile from the topics of a robot, with marks where it must be checked."""

import re
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from cmr.cli.errors import CommandError
from robot_driver.ros2.messages import (
    IMU,
    JOINT_STATE,
    ODOMETRY,
    POSE_STAMPED,
    POSE_WITH_COVARIANCE,
    TWIST,
    TWIST_STAMPED,
)
from robot_driver.ros2.profile import Profile, shipped

SIDES = {"left": re.compile("left|_l_|_l$|^l_", re.IGNORECASE), "right": re.compile("right|_r_|_r$|^r_", re.IGNORECASE)}
WHEEL = re.compile("wheel", re.IGNORECASE)
MULTIPLE = ("cmd_vel", "joint_states", "odom", "imu", "pose")  # preferred names among several topics of a type


class Topic(NamedTuple):
    """A topic: its name and type, whether it has publishers and subscribers, and whether all publish it reliably."""

    name: str
    kind: str
    is_published: bool
    is_taken: bool
    is_reliable: bool


class Found(NamedTuple):
    """What was found below a namespace: topics, and the names of joints by their topic."""

    namespace: str
    topics: Sequence[Topic]
    joints: Mapping[str, Sequence[str]]


def guessed(found: Found) -> tuple[str, list[str]]:
    """Return the text of a profile, and remarks. Raises CommandError if there is nothing to drive, or no source of the
    wheels' motion.
    """
    command = _first(found, (TWIST, TWIST_STAMPED), taken=True)
    if command is None:
        raise CommandError("No node takes a Twist or a TwistStamped: there is nothing that could be driven.")
    wheels = _wheels(found)
    gyro = _first(found, (IMU,))
    pose = _first(found, (POSE_STAMPED, POSE_WITH_COVARIANCE))
    known = _alike(found)
    remarks = ["command_timeout: find out whether the robot stops by itself when cmd_vel ends, and after which time."]
    if known is None:
        remarks.append("nominal: measure wheel radius and track; take the rest as a guess, which calibration replaces.")
    else:
        remarks.append(f"Joints and topics are like those of {known.name}: geometry and limits are from there.")
    if pose is None:
        remarks.append("pose: none is published; cmr-tracker or cmr-camera can say where the robot is.")
    parts = [_head(found, known), _command(found, command, known), *wheels]
    parts += [_sensor(found, "gyro", gyro)] if gyro is not None else []
    parts += [_sensor(found, "pose", pose)] if pose is not None else []
    return "".join([*parts, _nominal(known)]), remarks


def _first(found: Found, kinds: Sequence[str], *, taken: bool = False) -> Topic | None:
    """Return the usual topic of some types: by preferred name, then the shortest."""
    fitting = [one for one in found.topics if one.kind in kinds and (one.is_taken if taken else one.is_published)]

    def rank(topic: Topic) -> tuple[bool, int, str]:
        return topic.name.rpartition("/")[2] not in MULTIPLE, len(topic.name), topic.name

    return min(fitting, key=rank, default=None)


def _below(found: Found, name: str) -> str:
    """Return the name of a topic as in a profile: without the robot's namespace."""
    return name[len(found.namespace) + 1 :]


def _wheels(found: Found) -> list[str]:
    joints = _wheel_joints(found)
    if joints is not None:
        topic, left, right = joints
        return [
            f"wheels:\n  topic: {_below(found, topic.name)}\n  left: {_quoted(left)}\n  right: {_quoted(right)}\n",
            "  speed: rad/s                 # CHECK: m/s where the robot publishes those\n",
            f"  reliability: {_reliability(topic)}\n",
        ]
    odometry = _first(found, (ODOMETRY,))
    if odometry is None:
        raise CommandError("There are neither joints of wheels nor odometry: nothing says how the wheels turn.")
    return [
        f"wheels:                        # no joints of wheels are there\n  topic: {_below(found, odometry.name)}\n",
        f"  type: {ODOMETRY}\n  reliability: {_reliability(odometry)}\n",
    ]


def _wheel_joints(found: Found) -> tuple[Topic, list[str], list[str]] | None:
    for topic in found.topics:
        names = [name for name in found.joints.get(topic.name, ()) if WHEEL.search(name)]
        left, right = ([name for name in names if pattern.search(name)] for pattern in SIDES.values())
        if topic.kind == JOINT_STATE and left and len(left) == len(right):
            return topic, left, right
    return None


def _alike(found: Found) -> Profile | None:
    """Return the shipped profile whose robot has the same joints and topics."""
    joints = _wheel_joints(found)
    here = {_below(found, topic.name) for topic in found.topics}
    for name in shipped():
        profile = Profile.load(name)
        topics = {profile.command.topic, profile.wheels.topic} | ({profile.gyro.topic} if profile.gyro else set())
        mine = set() if joints is None else {*joints[1], *joints[2]}
        joined = {*profile.wheels.joints[0], *profile.wheels.joints[1]}
        if name != "example" and topics <= here and (joined <= mine if joined else not mine):
            return profile
    return None


def _head(found: Found, known: Profile | None) -> str:
    name = known.name if known is not None else "my robot"
    return (
        f"# Written by cmr-ros2 --probe from what was published below {found.namespace or '/'}.\n"
        "# Mend the lines with CHECK; docs/how_to/bring_your_turtlebot.md explains all of them.\n"
        f"schema: 1\nname: {name}\ntried: false\nsources:\n  - cmr-ros2 --probe\n"
        "base:\n"
        "  # command_timeout: 0.5        # CHECK: s after which the robot stops by itself when cmd_vel ends\n"
        "  source: nobody has said yet\n"
    )


def _command(found: Found, topic: Topic, known: Profile | None) -> str:
    speed, turn_rate = (known.command.speed, known.command.turn_rate) if known is not None else (0.2, 1.0)
    return (
        f"command:\n  topic: {_below(found, topic.name)}\n  type: {topic.kind}\n"
        f"  speed: {speed:g}                   # CHECK: m/s, the largest\n"
        f"  turn_rate: {turn_rate:g}               # CHECK: rad/s, the largest\n"
    )


def _sensor(found: Found, what: str, topic: Topic) -> str:
    return (
        f"{what}:\n  topic: {_below(found, topic.name)}\n  type: {topic.kind}\n  reliability: {_reliability(topic)}\n"
    )


def _nominal(known: Profile | None) -> str:
    if known is None:
        values = {"wheel_radius": 0.05, "base_width": 0.3, "response_time": 0.2, "top_wheel_speed": 20.0}
        about = "CHECK: measure wheel radius and track"
    else:
        nominal, about = known.nominal, f"CHECK: as of {known.name}"
        values = {"wheel_radius": nominal.wheel_radius, "base_width": nominal.base_width}
        values |= {"command_base_width": known.counted_width, "response_time": nominal.response_time}
        values |= {"top_wheel_speed": nominal.top_wheel_speed}
    lines = "".join(f"  {name}: {value:g}\n" for name, value in values.items())
    return f"nominal:                       # {about}\n{lines}"


def _quoted(names: Sequence[str]) -> str:
    return f'"{", ".join(names)}"'


def _reliability(topic: Topic) -> str:
    return "reliable" if topic.is_reliable else "best_effort"
