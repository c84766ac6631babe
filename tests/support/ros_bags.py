"""Bags of ROS 1 and ROS 2 with a robot's drive, written for tests, and mappings that import them."""

import math
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

import lcm
import numpy as np
import yaml
from rosbags.interfaces import Nodetype
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from cmr.bus.messages import decode
from cmr_tools.importing.import_log import main

START = 1_769_860_800_000_000_000  # ns; 2026-01-31T12:00:00Z
STEP = 50_000_000  # ns
DELAY = 2_000_000  # ns, from stamp to arrival
COUNT = 30
NOMINAL = {"wheel_radius": 0.05, "base_width": 0.2}
KINDS = ("ros1", "ros1_lz4", "ros1_bz2", "sqlite", "sqlite_message_zstd", "sqlite_file_zstd", "mcap", "mcap_zstd")

COUNTER = "std_msgs/Header header\nint32 left\nuint16 right\nuint16 unused\n"  # maker/msg/Ticks

Sent = tuple[str, str, int, dict[str, Any]]  # topic, type, stamp [ns], content


@cache
def typestore(is_ros1: bool) -> Any:
    store = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.LATEST)
    if is_ros1:
        store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage"))
    store.register(get_types_from_msg(COUNTER, "maker/msg/Ticks"))
    return store


def filled(store: Any, kind: str, content: dict[str, Any]) -> Any:
    """Return a message of zeros but for `content`."""
    values = {}
    for name, (node, what) in store.fielddefs[kind][1]:
        given = content.get(name)
        if node == Nodetype.NAME:
            values[name] = filled(store, what, given or {})
        elif node == Nodetype.BASE:
            zero: Any = "" if what[0] == "string" else 0.0 if "float" in what[0] else 0
            values[name] = zero if given is None else given
        else:
            (of, inner), size = what
            if of == Nodetype.NAME:
                values[name] = [filled(store, inner, one) for one in given or []]
            elif inner[0] == "string":
                values[name] = list(given or [])
            else:
                values[name] = np.array(np.zeros(size) if given is None else given, inner[0])
    return store.types[kind](**values)


def header(stamp: int, frame: str = "") -> dict[str, Any]:
    return {"stamp": {"sec": stamp // 10**9, "nanosec": stamp % 10**9}, "frame_id": frame}


def quaternion(yaw: float, length: float = 1.0) -> dict[str, float]:
    return {"z": length * math.sin(yaw / 2), "w": length * math.cos(yaw / 2)}


def drive() -> list[Sent]:
    """What a small robot says: every number differs from every other."""
    sent: list[Sent] = []
    for i in range(COUNT):
        stamp = START + i * STEP
        pose = {"position": {"x": 0.01 * i, "y": -0.02 * i}, "orientation": quaternion(0.3 * i, 0.5)}
        twist = {"linear": {"x": 0.25 + 0.001 * i}, "angular": {"z": 0.5 - 0.01 * i}}
        joints = {
            "name": ["arm", "left", "right"],
            "position": [9.0, 0.1 * i, -0.2 * i],
            "velocity": [9.0, 2.0 + i, -4.0],
        }
        transforms = [
            {"header": header(stamp, "map"), "child_frame_id": "odom", "transform": {"translation": {"x": 99.0}}},
            {
                "header": header(stamp, "odom"),
                "child_frame_id": "base",
                "transform": {"translation": {"x": 0.5 * i, "y": 1.0}, "rotation": quaternion(-0.1 * i)},
            },
        ]
        sent += [
            ("/cmd_vel", "geometry_msgs/msg/Twist", stamp, twist),
            ("/cmd_stamped", "geometry_msgs/msg/TwistStamped", stamp, {"header": header(stamp), "twist": twist}),
            ("/odom", "nav_msgs/msg/Odometry", stamp, {"header": header(stamp), "pose": {"pose": pose}}),
            ("/imu", "sensor_msgs/msg/Imu", stamp, {"header": header(stamp), "angular_velocity": {"z": 0.7 * i}}),
            ("/joint_states", "sensor_msgs/msg/JointState", stamp, {"header": header(stamp), **joints}),
            ("/tf", "tf2_msgs/msg/TFMessage", stamp, {"transforms": transforms}),
            ("/mocap", "geometry_msgs/msg/PoseStamped", stamp, {"header": header(stamp), "pose": pose}),
            (
                "/amcl",
                "geometry_msgs/msg/PoseWithCovarianceStamped",
                stamp,
                {"header": header(stamp), "pose": {"pose": pose}},
            ),
        ]
    return sent


def write_bag(folder: Path, kind: str, sent: Iterable[Sent]) -> Path:
    """Write the messages as rosbags writes them, each received DELAY after its stamp; return the bag's path."""
    is_ros1 = kind.startswith("ros1")
    path = folder / ("bag.bag" if is_ros1 else "bag")
    store = typestore(is_ros1)
    writer: Any = Writer1(path) if is_ros1 else Writer2(path, version=9, storage_plugin=_plugin(kind))
    if kind.startswith("ros1_"):
        writer.set_compression(Writer1.CompressionFormat[kind[5:].upper()])
    elif kind.endswith("_zstd"):
        mode = {"sqlite_message_zstd": CompressionMode.MESSAGE, "sqlite_file_zstd": CompressionMode.FILE}
        writer.set_compression(mode.get(kind, CompressionMode.STORAGE), CompressionFormat.ZSTD)
    serialize = store.serialize_ros1 if is_ros1 else store.serialize_cdr
    with writer:
        connections: dict[str, Any] = {}
        for topic, message_type, stamp, content in sent:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, message_type, typestore=store)
            data = serialize(filled(store, message_type, content), message_type)
            writer.write(connections[topic], stamp + DELAY, data)
    return path


def _plugin(kind: str) -> StoragePlugin:
    return StoragePlugin.MCAP if kind.startswith("mcap") else StoragePlugin.SQLITE3


def mapping_of(topics: dict[str, Any], **groups: Any) -> dict[str, Any]:
    topics = {name: {"time": clock} if isinstance(clock, str) else clock for name, clock in topics.items()}
    return {"about": "made in a test", "format": "ros_bag", "topics": topics, "nominal": NOMINAL, **groups}


def pose_at(topic: str, path: str) -> dict[str, Any]:
    return {
        "topic": topic,
        "x": {"field": f"{path}position.x", "unit": "m"},
        "y": {"field": f"{path}position.y", "unit": "m"},
        "theta": {"field": f"{path}orientation.yaw", "unit": "rad"},
    }


def command_at(topic: str, path: str = "") -> dict[str, Any]:
    return {
        "topic": topic,
        "full_scale": 20.0,
        "v": {"field": f"{path}linear.x", "unit": "m/s"},
        "omega": {"field": f"{path}angular.z", "unit": "rad/s"},
    }


def wheels() -> dict[str, Any]:
    block: dict[str, Any] = {"topic": "/joint_states", "ticks_per_turn": 1000}
    for side in ("left", "right"):
        block[f"ticks_{side}"] = {"field": f"position[{side}]", "unit": "rad"}
        block[f"psi_{side}"] = {"field": f"velocity[{side}]", "unit": "rad/s"}
    return block


GYRO = {"topic": "/imu", "yaw_rate": {"field": "angular_velocity.z", "unit": "rad/s"}}
WHOLE = mapping_of(
    {"/odom": "header", "/cmd_vel": "received", "/imu": "header", "/joint_states": "header"},
    motor_feedback=wheels(),
    motor_command=command_at("/cmd_vel"),
    gyro=GYRO,
    pose=pose_at("/odom", "pose.pose."),
)


def run(folder: Path, mapping: dict[str, Any], recording: Path, *options: str) -> dict[str, list[Any]]:
    """Import and return the log's messages by channel."""
    mapping_file, out = folder / "robot.yaml", folder / "run.lcm"
    mapping_file.write_text(yaml.safe_dump(mapping))
    assert main([str(mapping_file), str(recording), "--out", str(out), *options]) == 0
    messages: dict[str, list[Any]] = {}
    for event in lcm.EventLog(str(out), "r"):
        message = decode(event.channel, event.data).message
        assert event.timestamp == message.utime
        messages.setdefault(event.channel, []).append(message)
    return messages
