"""Recordings in windows, as other people publish them: pieces that begin in motion, late poses, a lidar that jumps.

A robot drives for two minutes; what is recorded are pieces of 2 to 10 s, each with its pose set to 0, 0, 0, at the
rates of bought robots. Some robots take duties, others (v, omega), which a velocity controller inside follows.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from cmr.recordings.recording import Recording
from cmr.recordings.signal import Floats, Signal
from tests.hidden_effects.cases import CONTROLLED_WINDOWS, WINDOWS, Case, Truth
from tests.hidden_effects.pieces import in_pieces, with_jumps
from tests.reference_plant import Commands
from tests.reference_plant.drives import utime
from tests.support.speed_commanded import wandering

LENGTHS = (2.0, 10.0)  # s, of pieces; all of one recording are as long
LATEST_POSE = 0.4  # s
RESPONSES = (0.1, 0.4)  # s, of velocity controllers
SHARE_OF_TOP = 0.7  # of the speed at full duty: what velocity controllers are asked for
JUMPING = 0.1  # of the pieces hold a jump of the poses
WHEELS_AND_GYRO, POSES = (2, 5), (1, 2, 3)  # one of so many samples was recorded: 50 or 20 Hz, 25, 12.5 or 8.3 Hz


def is_windowed(case: Case) -> bool:
    """Tell whether a case is recorded in windows."""
    return case.manoeuvre in (WINDOWS, CONTROLLED_WINDOWS)


def parameters_of_windows(case: Case, drawn: Mapping[str, float]) -> dict[str, float]:
    """Return the plant's parameters with which windows are recorded, from those `drawn` for the effects."""
    random = case.random("windows")
    latency, response = random.uniform(0.0, LATEST_POSE), random.uniform(*RESPONSES)
    late = {"pose_latency": latency} if "pose_latency" in case.effects else {}
    controlled = {"controller_response_time": response} if case.manoeuvre == CONTROLLED_WINDOWS else {}
    return {**drawn, **late, **controlled}


def velocities(truth: Truth, seed: int) -> tuple[Floats, Floats, Floats]:
    """Return times [s], v [m/s] and omega [rad/s] that the robot is told, (n,) each."""
    fastest = SHARE_OF_TOP * truth.nominal["wheel_radius"] / truth.nominal["k1"]
    return wandering(truth.case.seconds, seed, 0.6 * fastest, 0.8 * fastest / truth.nominal["base_width"])


def commands_of_controller(truth: Truth, seed: int) -> Commands:
    """Return the duties that stand for the wheel speeds which the controller makes of (v, omega).

    It counts with the base width that the owner believes.
    """
    time, v, omega = velocities(truth, seed)
    difference = omega * truth.nominal["base_width"] / 2.0
    radius, k1 = truth.nominal["wheel_radius"], truth.robot["k1"]
    left, right = (k1 * (v + sign * difference) / radius for sign in (-1.0, 1.0))
    return Commands(time, left, right)


def windowed(truth: Truth, recording: Recording) -> Recording:
    """Return what is published of the recording of a whole drive."""
    case = truth.case
    random = case.random("cutting", case.run)
    if case.manoeuvre == CONTROLLED_WINDOWS:
        time, v, omega = velocities(truth, case.drive_seed)
        nothing = Signal(recording.commands.utime[:0], {name: np.empty(0) for name in ("left", "right")})
        told = Signal(utime(time), {"v": v, "omega": omega})
        recording = replace(recording, commands=nothing, velocity_commands=told)
    every, every_pose = int(random.choice(WHEELS_AND_GYRO)), int(random.choice(POSES))
    recording = recording.where(
        {
            name: np.arange(len(recording.signals[name])) % rate == 0
            for name, rate in (("wheels", every), ("gyro", every), ("poses", every_pose))
        }
    )
    pieces = in_pieces(recording, float(random.uniform(*LENGTHS)))
    return with_jumps(pieces, JUMPING, random)
