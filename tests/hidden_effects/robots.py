"""Draw robots, and what their owners believe of them."""

from collections.abc import Mapping

import numpy as np

TYPICAL_ROBOT: Mapping[str, float] = {"wheel_radius": 0.04, "k2_over_k3": 118.0, "k1": 0.054, "base_width": 0.16}
SPREAD = 0.15  # share by which robots differ from the typical one, at most
BELIEF_ERRORS = (0.02, 0.08)  # share by which what is believed of a robot is off


def draw_robot(random: np.random.Generator) -> dict[str, float]:
    """Return the paper's parameters of a robot."""
    return {name: typical * random.uniform(1.0 - SPREAD, 1.0 + SPREAD) for name, typical in TYPICAL_ROBOT.items()}


def draw_nominal(robot: Mapping[str, float], random: np.random.Generator) -> dict[str, float]:
    """Return what is believed of the robot: its wheel radius as it is, all else some percent off."""
    wrong = {name: true * (1.0 + _either_sign(random) * random.uniform(*BELIEF_ERRORS)) for name, true in robot.items()}
    return {**wrong, "wheel_radius": robot["wheel_radius"]}


def scales(robot: Mapping[str, float]) -> dict[str, float]:
    """Return how much larger quantities are for this robot than for the typical one, by unit.

    "rad/s" is the yaw rate at full duty, "rad/s^2" the acceleration of a wheel at full duty.
    """
    share = {name: robot[name] / typical for name, typical in TYPICAL_ROBOT.items()}
    turn_rate = share["wheel_radius"] / share["k1"] / share["base_width"]
    return {
        "rad/s^2": share["k2_over_k3"],
        "1/rad": share["k2_over_k3"] * share["k1"] ** 2,
        "rad/s": turn_rate,
        "s/rad": 1.0 / turn_rate,
        "time constant": 1.0 / (share["k2_over_k3"] * share["k1"]),
        "base width": share["base_width"],
        "-": 1.0,
    }


def _either_sign(random: np.random.Generator) -> float:
    return float(random.choice((-1.0, 1.0)))
