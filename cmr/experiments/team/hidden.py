"""The true parameters of robots: the common and the individual deviations of a laboratory's robots.

These values stay hidden: a calibration only sees the sensors of such a robot.
"""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass

import numpy as np

from cmr.model.parameters import DEFINITIONS
from cmr.parameters.file import ParameterFile
from cmr.plant.parameters import PlantParameters, plant_parameters
from cmr.plant.sensors import slip_of_way

# Mean deviation of each of the paper's parameters from its data sheet.
FACTORS = {"wheel_radius": 1.0, "k2_over_k3": 1.3, "k1": 0.85, "base_width": 0.85}
# For a velocity controller; its k1 is the unit of its commands.
FACTORS_OF_CONTROLLER = {"wheel_radius": 1.0, "response_time": 1.3, "speed_scale": 0.97, "base_width": 0.85}
LARGEST_DRAW = 3.0  # standard deviations; a robot further out would have been returned to its maker


@dataclass(frozen=True, kw_only=True)
class HiddenRobot:
    """One real robot. The first four are as in the paper; each of the others has no effect if 0.

    With a `response_time` it has a velocity controller, which assumes a wheel speed of 1 / k1 at duty 1.

    The parameters of its motion are those of the plant, with the plant's names.
    """

    wheel_radius: float = 0.04  # m
    k2_over_k3: float = 118.0  # rad/s^2
    k1: float = 0.054  # s/rad
    base_width: float = 0.161  # m
    response_time: float = 0.0  # s
    speed_scale: float = 1.0  # reached share of the commanded speed
    command_base_width: float = 0.0  # m, with which the controller computes turns
    motor_gain_asymmetry: float = 0.0  # share by which the left side has more, and the right one less
    wheel_radius_asymmetry: float = 0.0  # likewise
    coulomb_friction: float = 0.0  # rad/s^2
    static_friction: float = 0.0  # rad/s^2 beyond the former, at rest; fades within 0.5 rad/s
    battery_sag: float = 0.0  # share of the voltage lost to one motor stalled at full duty
    command_delay: float = 0.0  # s
    turn_slip: float = 0.0  # s/rad; growth of the base width with the rate of turn
    longitudinal_slip: float = 0.0  # s; ground speed = wheel speed - this * wheel acceleration
    torque_noise: float = 0.0  # rad/s^2, standard deviation
    torque_noise_time: float = 0.1  # s, its correlation time
    slip_noise: float = 0.0  # m, standard deviation of a wheel's distance after 1 m
    gyro_bias: float = 0.0  # rad/s
    gyro_noise: float = 0.005  # rad/s, of each sample
    position_noise: float = 0.003  # m, of each coordinate of a pose
    heading_noise: float = 0.005  # rad
    ticks_per_turn: float = 2048.0  # of the encoder

    @property
    def parameters(self) -> PlantParameters:
        """The parameters for the plant."""
        own = {name: value for name, value in asdict(self).items() if name in PlantParameters._fields}
        controller = {
            "controller_response_time": self.response_time,
            "controller_scale": self.speed_scale,
            "controller_base_width": self.command_base_width,
        }
        return plant_parameters({**own, **controller, "gyro_bias": 0.0})

    @property
    def noise(self) -> tuple[float, float, float, float]:
        """Sizes and correlation times of torque and slip noise, for the plant."""
        return self.torque_noise, self.torque_noise_time, *slip_of_way(self.slip_noise)


# Beside the paper's parameters, of a robot as small as the paper's; frictions are for k2_over_k3 of 118 rad/s^2.
USUAL = HiddenRobot(
    coulomb_friction=5.0,
    static_friction=1.0,
    battery_sag=0.03,
    command_delay=0.03,
    turn_slip=0.01,
    longitudinal_slip=0.002,
    torque_noise=1.0,
    slip_noise=0.002,
)
# Variation within a robot type: standard deviations of logarithms, and of signed parameters.
SPREAD = {
    "wheel_radius": 0.005,
    "k2_over_k3": 0.06,
    "k1": 0.04,
    "base_width": 0.02,
    "coulomb_friction": 0.25,
    "static_friction": 0.25,
    "battery_sag": 0.25,
    "turn_slip": 0.25,
    "longitudinal_slip": 0.25,
}
SPREAD_OF_CONTROLLER = {"response_time": 0.06, "speed_scale": 0.01}  # instead of its motors'
SIGNED_SPREAD = {"motor_gain_asymmetry": 0.015, "wheel_radius_asymmetry": 0.0025, "gyro_bias": 0.002}
TORQUES = ("coulomb_friction", "static_friction", "torque_noise")
CONTROLLER = ("response_time", "speed_scale", "command_base_width")
SENSORS = ("gyro_noise", "position_noise", "heading_noise", "ticks_per_turn", "torque_noise_time")


def believed_of(file: ParameterFile) -> dict[str, float]:
    """Return the believed parameters from a parameter file, for a Laboratory.

    Raises ParameterFileError naming the first parameter that is missing.
    """
    believed = {name: file.robot_parameters.values[name] for name in DEFINITIONS}
    controller = file.velocity_controller
    if controller is None:
        return believed
    own = {"response_time": file.value("response_time"), "command_base_width": controller.base_width}
    scale = file.value("speed_scale") if file.has("speed_scale") else 1.0
    return {**believed, **own, "speed_scale": scale, "k1": 1.0 / controller.top_wheel_speed}


@dataclass(frozen=True)
class Laboratory:
    """The robots of a laboratory: one per id, always the same for the same `seed`.

    `believed` are the parameters assumed by all programs, as from `believed_of`. `size` scales the differences of the
    robots from these and from each other: 1 is usual, 0 is none.
    """

    believed: Mapping[str, float]
    seed: int = 0
    size: float = 1.0

    def robot(self, robot_id: int) -> HiddenRobot:
        """Return one robot."""
        random = np.random.default_rng([self.seed, robot_id])
        drawn: dict[str, float] = {name: self.size * size for name, size in asdict(USUAL).items()}
        controlled = "response_time" in self.believed
        drawn |= {name: self.believed.get(name, getattr(USUAL, name)) for name in (*DEFINITIONS, *CONTROLLER)}
        factors = FACTORS_OF_CONTROLLER if controlled else FACTORS
        drawn |= {name: self.believed[name] * factor**self.size for name, factor in factors.items()}
        drawn |= {name: getattr(USUAL, name) for name in SENSORS}
        for name in TORQUES:
            drawn[name] *= drawn["k2_over_k3"] / USUAL.k2_over_k3
        motors = {name: SPREAD[name] for name in ("k2_over_k3", "k1")}
        spreads = SPREAD | SIGNED_SPREAD | (dict.fromkeys(motors, 0.0) | SPREAD_OF_CONTROLLER if controlled else {})
        for name, spread in spreads.items():
            deviation = self.size * spread * float(np.clip(random.standard_normal(), -LARGEST_DRAW, LARGEST_DRAW))
            drawn[name] = deviation if name in SIGNED_SPREAD else drawn[name] * math.exp(deviation)
        return HiddenRobot(**drawn)
