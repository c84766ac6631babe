"""Draw how large effects are: within a quarter of their typical size, which scales with the robot."""

import math
from collections.abc import Mapping

import numpy as np

from tests.hidden_effects.laws.kinds import KINDS
from tests.hidden_effects.robots import scales
from tests.hidden_effects.unknown import UNKNOWN
from tests.reference_plant import TYPICAL

ALL: Mapping[str, Mapping[str, float]] = {
    **TYPICAL,
    **{name: kind.sizes for name, kind in KINDS.items()},
    **UNKNOWN,
}
SPREAD = 0.25  # share of the typical size
MIDDLE_THIRD = (1.0 / 3.0, 2.0 / 3.0)  # of the drive; when things change that change at a time

# What the size of a parameter grows with; the others are the same for every robot.
GROWS_WITH: Mapping[str, str] = {
    "coulomb_friction": "rad/s^2",
    "static_friction": "rad/s^2",
    "slope_x": "rad/s^2",
    "slope_y": "rad/s^2",
    "surface_patch_friction": "rad/s^2",
    "quadratic_drag": "1/rad",
    "turn_rate_limit": "rad/s",
    "caster_flip": "rad/s",
    "turn_slip": "s/rad",
    "travel_reduction_share": "s/rad",
    "lateral_skid": "s/rad",
    "longitudinal_slip": "time constant",
    "pose_offset": "base width",
    "pose_offset_lateral": "base width",
    **dict.fromkeys(("boundary_lubrication", "bearing_drag", "brake_drag", "cogging"), "rad/s^2"),
    **dict.fromkeys(("turning_resistance", "floor_sag", "reel_pull"), "rad/s^2"),
    "mass_ahead": "base width",
}
# Parameters that are as likely negative as positive.
EITHER_SIGN = frozenset(
    {
        "motor_gain_asymmetry",
        "back_emf_asymmetry",
        "wheel_radius_scale",
        "wheel_radius_asymmetry",
        "turn_asymmetry",
        "surface_change_k1",
        "surface_change_base_width",
        "surface_patch_base_width",
        "encoder_scale",
        "encoder_asymmetry",
        "gyro_bias",
        "gyro_scale",
        "gyro_drift",
        "clock_skew",
        "pose_offset",
        "pose_offset_lateral",
        "pose_heading_offset",
        "pose_distortion",
        "floor_camber",
        "gyro_magnetism",
        "pose_heading_warp",
        "mass_ahead",
        "gyro_asymmetry",
        "gyro_vibration",
        "gyro_warm_up",
        "pixel_aspect",
    }
)
SLOPE = math.hypot(*TYPICAL["slope"].values())  # rad/s^2
COARSE_DISCS = (40.0, 48.0, 60.0)  # ticks; whole steps of an encoder that is taken for one of 480


def draw_sizes(
    effect: str, robot: Mapping[str, float], seconds: float, random: np.random.Generator
) -> dict[str, float]:
    """Return the parameters of an effect, or of physics that no effect describes, in a drive of `seconds`.

    A surface_patch and a slippery_spot have no place yet.
    """
    if effect == "encoder_quantisation":
        return {"encoder_quantisation": float(random.choice(COARSE_DISCS))}
    if effect == "slope":
        size, uphill = SLOPE * _share(random) * scales(robot)["rad/s^2"], random.uniform(-math.pi, math.pi)
        return {"slope_x": size * math.cos(uphill), "slope_y": size * math.sin(uphill)}
    return {name: _size(name, typical, robot, seconds, random) for name, typical in ALL[effect].items()}


def _size(name: str, typical: float, robot: Mapping[str, float], seconds: float, random: np.random.Generator) -> float:
    if name.endswith("_time"):
        return seconds * float(random.uniform(*MIDDLE_THIRD))
    if name.endswith(("_phase", "_direction")):
        return float(random.uniform(-math.pi, math.pi))
    sign = random.choice((-1.0, 1.0)) if name in EITHER_SIGN else 1.0
    return float(sign * typical * _share(random) * scales(robot)[GROWS_WITH.get(name, "-")])


def _share(random: np.random.Generator) -> float:
    return float(random.uniform(1.0 - SPREAD, 1.0 + SPREAD))
