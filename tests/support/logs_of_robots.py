"""Logs of one robot, of two, and of none."""

from pathlib import Path

from cmr.bus.messages import make
from cmr.msg import pose_xyt_t
from tests.support.emulated_drive import IDEAL, Message, messages, write_log

ROBOTS = {"a": [0], "b": [0], "c": [0, 3], "d": [3], "none": []}  # by the name of the log


def write_logs(folder: Path) -> Path:
    """Write a.lcm, b.lcm and so on with the robots of ROBOTS; return the folder."""
    drive = messages(IDEAL, seconds=4.0, rest=0.5)
    for name, robots in ROBOTS.items():
        write_log(folder / f"{name}.lcm", [entry for robot_id in robots for entry in _of_robot(drive, robot_id)])
    return folder


def _of_robot(drive: list[Message], robot_id: int) -> list[Message]:
    """Return the poses of a drive as those of another robot; robot 0's drive as it is."""
    if robot_id == 0:
        return drive
    poses = [message for channel, message in drive if channel == "POSE_0"]
    fields = ("utime", "x", "y", "theta")
    return [
        (f"POSE_{robot_id}", make(pose_xyt_t, robot_id=robot_id, **{name: getattr(pose, name) for name in fields}))
        for pose in poses
    ]
