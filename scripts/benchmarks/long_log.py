"""A log as of an hour in a laboratory: ten robots with twins, 20 virtual ones, range scans, a camera, calibrations."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from cmr import msg
from cmr.bus.messages import make
from cmr.bus.world_state import WorldState
from cmr.recordings.events import HEADER, SYNC

BEGIN = 1_700_000_000_000_000  # us
STEP = 10_000  # us
STEPS = 100  # per second
ROBOTS, VIRTUAL = 10, 20
PICTURE = 20_000  # bytes
CALIBRATION_LASTS = 120  # s
CALIBRATION_EVERY = 300  # s after which the next robot is calibrated
UTIME = slice(8, 16)  # bytes of the timestamp in a message
OF_EACH_ROBOT = {  # steps between messages, type
    "MOTOR_FEEDBACK": (1, msg.motor_feedback_t),
    "GYRO": (1, msg.gyro_t),
    "MOTOR_COMMAND": (2, msg.motor_command_t),
    "POSE": (2, msg.pose_xyt_t),
    "ROBOT_STATE": (2, msg.robot_state_t),
    "RANGE_SCAN": (10, msg.range_scan_t),
    "PARAMETERS": (100, msg.parameters_t),
}
TEXTS = {"sha256": "ab" * 32, "yaml": "k1: 0.05\n" * 50, "ranges": np.linspace(0.5, 8.0, 360).tolist()}


def write(path: Path, seconds: int) -> None:
    """Write a log of this duration; an hour has 2.6 GB. Raises OSError."""
    templates = [(channel, every, _template(kind, robot)) for channel, every, kind, robot in _channels()]
    ids = np.array([*range(ROBOTS), *range(ROBOTS), *range(100, 100 + VIRTUAL)])
    origins = np.repeat([0, 2, 1], [ROBOTS, ROBOTS, VIRTUAL])
    number = 0
    with path.open("wb") as stream:
        for step in range(STEPS * seconds):
            utime = BEGIN + STEP * step
            parts = []
            for channel, every, template in templates:
                if step % every == 0:
                    template[UTIME] = utime.to_bytes(8, "big")
                    parts.append((channel, bytes(template)))
            parts += [(channel.encode(), message.encode()) for channel, message in _others(step, utime, ids, origins)]
            for channel, data in parts:
                stream.write(HEADER.pack(SYNC, number, utime, len(channel), len(data)) + channel + data)
                number += 1


def _channels() -> Iterator[tuple[bytes, int, Any, int]]:
    for robot in range(ROBOTS):
        for name, (every, kind) in OF_EACH_ROBOT.items():
            yield f"{name}_{robot}".encode(), every, kind, robot


def _template(kind: Any, robot: int) -> bytearray:
    """Return the bytes of a message with zeros, and with the strings and arrays of TEXTS."""
    message = kind()
    values = {name: TEXTS.get(name, 0) for name in message.__slots__ if name != "n"}
    return bytearray(make(kind, **{**values, "robot_id": robot}).encode())


def _others(step: int, utime: int, ids: Any, origins: Any) -> Iterator[tuple[str, Any]]:
    if step % 2 == 0:
        yield "WORLD_STATE", _world(step / STEPS, utime, ids, origins)
    if step % 10 == 5:
        picture = make(msg.camera_image_t, utime=utime, camera="ceiling", width=1280, height=720, jpeg=bytes(PICTURE))
        yield "CAMERA_IMAGE", picture
    if step % STEPS == 7:
        for process in ("cmr-sim", "cmr-driver", "cmr-diagnose"):
            yield "PROCESS_STATUS", _status(process, utime)
    if step % 50 == 9:
        yield from _calibration(step // STEPS, utime)


def _world(seconds: float, utime: int, ids: Any, origins: Any) -> WorldState:
    """Return robots on circles; their twins are 3 cm beside them."""
    angle, radius, zeros = 0.3 * seconds / (1 + ids % 7) + ids, 0.5 + 0.2 * (ids % 23), np.zeros(len(ids))
    x, y = radius * np.cos(angle) + 0.03 * (origins == 2), radius * np.sin(angle)
    return WorldState(utime, ids, origins, x, y, angle + np.pi / 2, zeros + 5.0, zeros + 6.0, zeros, zeros)


def _status(process: str, utime: int) -> Any:
    fields = {"process": process, "host": "lab", "pid": len(process), "state": 1, "parameters_sha256": "ab" * 32}
    return make(msg.process_status_t, utime=utime, **fields, loop_rate_hz=99.9, loop_overruns=0.0, message="Watching.")


def _calibration(second: int, utime: int) -> Iterator[tuple[str, Any]]:
    """Yield CALIBRATION_STATUS of the robot that is being calibrated, if any; robots are calibrated in turn."""
    robot, since = second // CALIBRATION_EVERY, second % CALIBRATION_EVERY
    if robot < ROBOTS and since <= CALIBRATION_LASTS:
        fields = dict.fromkeys(("k2_over_k3_std", "k1_std", "base_width_std"), 0.01)
        fields |= dict.fromkeys(("path_rmse_before", "path_rmse_after"), 0.1)
        fields |= {"k2_over_k3": 118.0, "k1": 0.05, "base_width": 0.16, "progress": since / CALIBRATION_LASTS}
        state = msg.calibration_status_t.DONE if since == CALIBRATION_LASTS else msg.calibration_status_t.COLLECTING
        status = make(msg.calibration_status_t, utime=utime, robot_id=robot, state=state, message="Drives.", **fields)
        yield f"CALIBRATION_STATUS_{robot}", status
