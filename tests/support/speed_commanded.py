"""Recordings of made-up robots with a velocity controller inside: of the plant, which shares no code with the model."""

import math
from dataclasses import dataclass, replace

import numpy as np

from cmr.parameters.file import ParameterFile, Value
from cmr.recordings.recording import Recording
from cmr.recordings.signal import Floats, Signal
from tests.reference_plant import REALISTIC, Commands, Noise, drive
from tests.reference_plant.drives import utime

COMMAND_RATE = 20.0  # Hz


@dataclass(frozen=True)
class SpeedRobot:
    """A robot that is told how fast to go: its geometry [m], the response of its controller and its limits."""

    wheel_radius: float = 0.165
    base_width: float = 0.55
    command_base_width: float = 0.55
    response_time: float = 0.3
    delay: float = 0.08
    speed_scale: float = 1.0
    top_wheel_speed: float = 12.0

    def plant(self, **effects: float) -> dict[str, float]:
        """Return the parameters of the plant."""
        return {
            "wheel_radius": self.wheel_radius,
            "base_width": self.base_width,
            "k1": 1.0 / self.top_wheel_speed,
            "controller_response_time": self.response_time,
            "controller_scale": self.speed_scale,
            "command_delay": self.delay,
            **effects,
        }

    @property
    def nominal(self) -> ParameterFile:
        """Return what the owner knows."""
        return ParameterFile(
            0, {"wheel_radius": Value(self.wheel_radius), "base_width": Value(self.command_base_width)}
        )


def wandering(seconds: float, seed: int, v: float = 0.5, omega: float = 0.6) -> tuple[Floats, Floats, Floats]:
    """Return times [s] and (v, omega) as somebody may drive: held for a second or two, ramps, and rest at both ends."""
    random = np.random.default_rng(seed)
    time = np.arange(round(seconds * COMMAND_RATE)) / COMMAND_RATE
    columns = []
    for size, sign in ((v, 0.3), (omega, 0.5)):
        borders = np.cumsum(random.uniform(0.7, 2.5, math.ceil(seconds)))
        levels = (
            size * random.uniform(0.2, 1.0, len(borders) + 1) * np.where(random.random(len(borders) + 1) < sign, -1, 1)
        )
        held = levels[np.searchsorted(borders, time)]
        columns.append(np.where((time < 2.0) | (time > seconds - 2.0), 0.0, held))
    return time, columns[0], columns[1]


def driven(
    robot: SpeedRobot,
    seconds: float = 60.0,
    seed: int = 0,
    *,
    noise: Noise = REALISTIC,
    wheel_speeds: bool = False,
    v: float = 0.5,
    omega: float = 0.6,
    **effects: float,
) -> Recording:
    """Return the recording of a drive by (v, omega), or by the wheel speeds that these ask for."""
    time, forward, turn = wandering(seconds, seed, v, omega)
    difference = turn * robot.command_base_width / 2.0
    wheels = [(forward + sign * difference) / robot.wheel_radius for sign in (-1.0, 1.0)]
    duties = [speed / robot.top_wheel_speed for speed in wheels]
    recorded = drive(
        Commands(time, *duties), robot.plant(**effects), seconds, noise, seed, nominal=robot.nominal
    ).recording
    nothing = Signal(recorded.commands.utime[:0], {name: np.empty(0) for name in ("left", "right")})
    if wheel_speeds:
        told = Signal(utime(time), dict(zip(("psi_left", "psi_right"), wheels, strict=True)))
        return replace(recorded, commands=nothing, wheel_speed_commands=told)
    return replace(recorded, commands=nothing, velocity_commands=Signal(utime(time), {"v": forward, "omega": turn}))
