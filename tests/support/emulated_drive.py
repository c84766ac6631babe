"""Figure-eight drives of the emulated robot as messages: the emulator's physics share no code with the model."""

import dataclasses
import math
import random
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import lcm

from cmr.bus.messages import make
from cmr.bus.streams import GYRO, MOTOR_COMMAND, MOTOR_FEEDBACK, PARAMETERS, POSE
from cmr.msg import gyro_t, motor_command_t, motor_feedback_t, pose_xyt_t
from cmr.parameters.file import ParameterFile, Value
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.settings import Settings, load_settings

TRUTH = load_settings().truth
DEFAULT = dataclasses.replace(load_settings(), effects={})  # but both its motors and all its wheels are alike
IDEAL = DEFAULT.ideal()
EPOCH = 1_700_000_000_000_000  # us
NOMINAL = ParameterFile(
    0, {"wheel_radius": Value(0.04), "k2_over_k3": Value(80.0), "k1": Value(0.065), "base_width": Value(0.2)}
)
Message = tuple[str, Any]  # channel, message


def figure_eight(share: float) -> tuple[float, float]:
    """Duties (left, right) at this share of a figure-eight: one lobe to the left, one to the right."""
    turning = 0.09 * math.sin(2.0 * math.pi * share)
    return 0.42 - turning, 0.42 + turning


def straight(_share: float) -> tuple[float, float]:
    """Duties of a straight drive."""
    return 0.42, 0.42


def messages(
    settings: Settings = DEFAULT,
    *,
    seed: int = 0,
    seconds: float = 30.0,
    rest: float = 1.5,
    duties: Any = figure_eight,
    channels: Iterable[str] = ("MOTOR_COMMAND", "MOTOR_FEEDBACK", "GYRO", "POSE", "PARAMETERS"),
) -> list[Message]:
    """Return all messages of a drive of `seconds` between two rests, in order of time, robot 0."""
    plant = Plant(dataclasses.replace(settings, seed=seed))
    noise = random.Random(seed)
    scale = 2.0 * math.pi / settings.robot.ticks_per_turn
    wanted = set(channels)
    announcement = NOMINAL.announcement(sequence=EPOCH)
    announcement.utime = EPOCH
    result: list[Message] = [(PARAMETERS.channel(0), announcement)]
    ticks, left, right = (0.0, 0.0), 0.0, 0.0
    for k in range(int((seconds + 2.0 * rest) * 100)):
        time, utime = k * 0.01, EPOCH + k * 10_000
        plant.advance(time)
        counts = plant.encoder_counts()
        psi = [(new - old) * scale / 0.01 for new, old in zip(counts, ticks, strict=True)]
        ticks = counts
        if k % 2 == 0:
            driving = rest <= time < rest + seconds
            left, right = duties((time - rest) / seconds) if driving else (0.0, 0.0)
            command = make(motor_command_t, utime=utime, robot_id=0, left=left, right=right)
            result.append((MOTOR_COMMAND.channel(0), command))
            plant.command(left, right)
            result.append((POSE.channel(0), _pose(utime, plant, settings, noise)))
        result.append((MOTOR_FEEDBACK.channel(0), _feedback(utime, counts, psi, left, right)))
        result.append((GYRO.channel(0), _gyro(utime, psi, settings, noise)))
    return [message for message in result if message[0].rpartition("_")[0] in wanted]


def write_log(path: Path, drive: list[Message]) -> Path:
    """Write messages as an LCM event log."""
    log = lcm.EventLog(str(path), "w", overwrite=True)
    for channel, message in drive:
        log.write_event(message.utime, channel, message.encode())
    log.close()
    return path


def _pose(utime: int, plant: Plant, settings: Settings, noise: random.Random) -> Any:
    size = settings.imperfections.pose_noise
    return make(
        pose_xyt_t,
        utime=utime,
        robot_id=0,
        x=plant.x + noise.gauss(0.0, size.position),
        y=plant.y + noise.gauss(0.0, size.position),
        theta=math.remainder(plant.theta + noise.gauss(0.0, size.heading), 2.0 * math.pi),
    )


def _gyro(utime: int, psi: list[float], settings: Settings, noise: random.Random) -> Any:
    yaw_rate = settings.robot.wheel_radius * (psi[1] - psi[0]) / settings.robot.base_width
    measured = yaw_rate + noise.gauss(0.0, settings.imperfections.gyro_noise.size)
    return make(gyro_t, utime=utime, robot_id=0, yaw_rate=measured, valid=1, received_utime=utime)


def _feedback(utime: int, counts: tuple[float, float], psi: list[float], left: float, right: float) -> Any:
    return make(
        motor_feedback_t,
        utime=utime,
        robot_id=0,
        ticks_left=int(counts[0]),
        ticks_right=int(counts[1]),
        psi_left=psi[0],
        psi_right=psi[1],
        applied_left=left,
        applied_right=right,
        current_left=math.nan,
        current_right=math.nan,
        battery_voltage=math.nan,
        temperature=math.nan,
        status=0,
        received_utime=utime,
        applied_utime=0,
    )
