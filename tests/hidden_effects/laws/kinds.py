"""Kinds of physics from the literature that no effect describes: how large they are, and the law that is true of them.

The physics is in cmr/plant (beyond_motors, beyond_ground, beyond_sensors), each with its source. The laws here are the
study's own words, used only to judge what a diagnosis answers.

Three kinds are older ones of the plant that have sources too. cubic_motor: Roboteq, AX2500/2850 user's manual, 2005,
"Command control curves" (exponential). weak_reverse: the same, "Left / right tuning adjustment": motors with advanced
brushes run better in one direction. coasting: Texas Instruments, DRV8871 data sheet: both inputs low let the motor
coast.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from cmr.recordings.signal import Floats
from tests.hidden_effects.laws.states import States

Values = Mapping[str, float]
Column = Callable[[States, Values], Floats]


@dataclass(frozen=True)
class TrueLaw:
    """What one kind adds at a place of the model, up to its coefficient.

    `place` and `side` are words of cmr.model.laws. `words` is the formula; it is one of its grammar if `in_grammar`.
    `column` gives its value for true states and the plant's parameters, one column for each side at the wheels.
    """

    place: str
    words: str
    column: Column
    side: str = ""
    in_grammar: bool = True


@dataclass(frozen=True)
class Kind:
    """One kind of physics: typical sizes in the plant's units, and its laws; none where no formula of the state is."""

    sizes: Values
    laws: tuple[TrueLaw, ...] = ()

    @property
    def in_grammar(self) -> bool:
        """Whether formulas of the grammar say all of it."""
        return bool(self.laws) and all(law.in_grammar for law in self.laws)


def _wheel(words: str, column: Column, side: str = "both", **rest: bool) -> TrueLaw:
    return TrueLaw("wheel_acceleration", words, column, side, **rest)


def _on_left(column: Floats) -> Floats:
    return np.asarray(column * np.array([1.0, 0.0]), np.float64)


def _dead_zone(value: Floats, limit: float) -> Floats:
    return value - np.clip(value, -limit, limit)


def _in_disc(s: States, p: Values) -> Floats:
    off = np.hypot(s.x - p["slippery_spot_x"], s.y - p["slippery_spot_y"])
    return np.asarray(off < p["slippery_spot_radius"], np.float64)


def _scrubbing(s: States, p: Values) -> Floats:
    curvature = 2.0 * np.abs(s.v) / np.maximum(np.abs(s.difference), 1e-6)
    width = 1.0 + p["curvature_slip"] / (1.0 + p["curvature_slip_scale"] * np.sqrt(curvature))
    return s.w * (1.0 / width - 1.0)


def _reel(s: States, p: Values) -> Floats:
    x, y = s.x - p["reel_x"], s.y - p["reel_y"]
    ahead = x * np.cos(s.theta) + y * np.sin(s.theta)
    return ahead / np.sqrt(x * x + y * y + 0.01) * np.ones(2)


def _braking_beyond(s: States, p: Values) -> Floats:
    return np.where(s.effort * s.psi < 0.0, _dead_zone(s.effort, p["regeneration_limit"]), 0.0)


KINDS: Mapping[str, Kind] = {
    # Electronics and motors.
    "cubic_motor": Kind({"cubic_motor": 0.05}, (_wheel("u**3", lambda s, _p: s.u**3),)),
    "weak_reverse": Kind({"weak_reverse": 0.027}, (_wheel("abs(u)", lambda s, _p: np.abs(s.u)),)),
    "bridge_loss": Kind(
        {"bridge_loss": 0.006},
        (_wheel("clip(effort, d)", lambda s, p: np.clip(s.effort, -p["bridge_loss"], p["bridge_loss"])),),
    ),
    "armature_reaction": Kind(
        {"armature_reaction": 0.05}, (_wheel("effort * abs(effort)", lambda s, _p: s.effort * np.abs(s.effort)),)
    ),
    "winding_heat": Kind(
        {"winding_heat": 3.0, "winding_heat_memory": 12.0},
        (
            _wheel(
                "effort * low_pass(effort**2, memory)",
                lambda s, p: s.effort * s.low_pass(s.effort**2, p["winding_heat_memory"]),
            ),
        ),
    ),
    "battery_relaxation": Kind(
        {"battery_relaxation": 0.14, "battery_relaxation_memory": 8.0},
        (_wheel("u * low_pass(load, memory)", lambda s, p: s.u * s.low_pass(s.load, p["battery_relaxation_memory"])),),
    ),
    "gear_loss": Kind(
        {"gear_loss": 0.035},
        (_wheel("abs(effort) * sign(psi)", lambda s, _p: np.abs(s.effort) * np.tanh(s.psi / 0.1)),),
    ),
    "boundary_lubrication": Kind(
        {"boundary_lubrication": 1.1, "boundary_lubrication_speed": 5.0},
        (
            _wheel(
                "sign(psi) * exp(-abs(psi) / speed)",
                lambda s, p: np.tanh(s.psi / 0.1) * np.exp(-np.abs(s.psi) / p["boundary_lubrication_speed"]),
            ),
        ),
    ),
    "brake_drag": Kind(
        {"brake_drag": 0.75}, (_wheel("sign(psi)", lambda s, _p: _on_left(np.tanh(s.psi / 0.1)), "left"),)
    ),
    "cross_coupling": Kind({"cross_coupling": 0.02}, (_wheel("other_psi", lambda s, _p: s.other(s.psi)),)),
    "turning_resistance": Kind(
        {"turning_resistance": 0.9, "turning_resistance_rate": 0.5},
        (
            _wheel(
                "tanh(w / rate)",
                lambda s, p: np.tanh(s.w / p["turning_resistance_rate"]) * np.array([1.0, -1.0]),
                "opposite",
            ),
        ),
    ),
    "mass_ahead": Kind(
        {"mass_ahead": 0.005},
        (
            _wheel("w**2", lambda s, _p: s.w**2 * np.ones(2)),
            _wheel("v * w", lambda s, _p: s.v * s.w * np.array([1.0, -1.0]), "opposite"),
        ),
    ),
    "floor_sag": Kind(
        {"floor_sag": 0.6},
        (_wheel("x * cos(theta) + y * sin(theta)", lambda s, _p: s.ahead_of_origin * np.ones(2)),),
    ),
    # Ways over the ground.
    "understeer": Kind({"understeer": 0.18}, (TrueLaw("yaw_rate", "w * v**2", lambda s, _p: s.w * s.v**2),)),
    "breakaway_skid": Kind(
        {"breakaway_skid": 0.2, "breakaway_skid_from": 0.15},
        (
            TrueLaw(
                "lateral_speed", "dead_zone(v * w, from)", lambda s, p: _dead_zone(s.v * s.w, p["breakaway_skid_from"])
            ),
        ),
    ),
    "carpet_drift": Kind(
        {"carpet_drift": 0.06, "carpet_drift_direction": 0.0},
        (
            TrueLaw(
                "forward_speed",
                "abs(v) * cos(theta), abs(v) * sin(theta)",
                lambda s, p: np.abs(s.v) * np.cos(s.theta - p["carpet_drift_direction"]),
            ),
            TrueLaw(
                "lateral_speed",
                "abs(v) * sin(theta), abs(v) * cos(theta)",
                lambda s, p: np.abs(s.v) * np.sin(p["carpet_drift_direction"] - s.theta),
            ),
        ),
    ),
    "puncture": Kind(
        {"puncture": 0.013, "puncture_time": 60.0},
        (
            TrueLaw(
                "wheel_slip",
                "psi * step(t, time)",
                lambda s, p: _on_left(s.psi * (s.t >= p["puncture_time"])),
                "left",
            ),
        ),
    ),
    "slippery_spot": Kind(
        {"slippery_spot": 0.3, "slippery_spot_x": 0.0, "slippery_spot_y": 0.0, "slippery_spot_radius": 0.5},
        (TrueLaw("forward_speed", "v * disc(x, y, radius)", lambda s, p: s.v * _in_disc(s, p)),),
    ),
    # Sensors.
    "encoder_overspeed": Kind(
        {"encoder_overspeed": 0.04, "encoder_overspeed_from": 7.0},
        (
            TrueLaw(
                "encoder_rate",
                "dead_zone(psi, from)",
                lambda s, p: _dead_zone(s.psi, p["encoder_overspeed_from"]),
                "both",
            ),
        ),
    ),
    "gyro_asymmetry": Kind({"gyro_asymmetry": 0.006}, (TrueLaw("gyro", "abs(w)", lambda s, _p: np.abs(s.w)),)),
    "gyro_vibration": Kind({"gyro_vibration": 0.04}, (TrueLaw("gyro", "v**2", lambda s, _p: s.v**2),)),
    "gyro_warm_up": Kind(
        {"gyro_warm_up": 0.018, "gyro_warm_up_memory": 25.0},
        (TrueLaw("gyro", "exp(-t / memory)", lambda s, p: np.exp(-s.t / p["gyro_warm_up_memory"])),),
    ),
    "gyro_field": Kind(
        {"gyro_field": 0.009, "gyro_field_direction": 0.0},
        (TrueLaw("gyro", "cos(theta), sin(theta)", lambda s, p: np.cos(s.theta - p["gyro_field_direction"])),),
    ),
    "lidar_imbalance": Kind(
        {"lidar_imbalance": 0.0066, "lidar_imbalance_frequency": 5.5, "lidar_imbalance_phase": 0.0},
        (
            TrueLaw(
                "gyro",
                "sin(frequency * t), cos(frequency * t)",
                lambda s, p: np.sin(2.0 * np.pi * p["lidar_imbalance_frequency"] * s.t + p["lidar_imbalance_phase"]),
            ),
        ),
    ),
    "body_roll": Kind({"body_roll": 0.06}, (TrueLaw("pose_beside", "v * w", lambda s, _p: s.v * s.w),)),
    "pixel_aspect": Kind({"pixel_aspect": 0.03}, (TrueLaw("pose_x", "x", lambda s, _p: s.x),)),
    "compass_deviation": Kind(
        {"compass_deviation": 0.02, "compass_deviation_direction": 0.0},
        (
            TrueLaw(
                "pose_theta",
                "cos(theta), sin(theta)",
                lambda s, p: np.cos(s.theta - p["compass_deviation_direction"]),
            ),
        ),
    ),
    # What the grammar does not have: another power, an angle of the wheel, a limit in one quadrant, a direction to a
    # place, a root of a curvature, a duty within a threshold, a mass on a spring.
    "bearing_drag": Kind(
        {"bearing_drag": 0.85},
        (
            _wheel(
                "sign(psi) * abs(psi)**(2/3)",
                lambda s, _p: np.sign(s.psi) * np.abs(s.psi) ** (2.0 / 3.0),
                in_grammar=False,
            ),
        ),
    ),
    "cogging": Kind(
        {"cogging": 0.6, "cogging_phase": 0.0},
        (_wheel("sin(6 phi + phase)", lambda s, p: np.sin(6.0 * s.phi + p["cogging_phase"]), in_grammar=False),),
    ),
    "regeneration_limit": Kind(
        {"regeneration_limit": 1.15}, (_wheel("the braking effort beyond a limit", _braking_beyond, in_grammar=False),)
    ),
    "reel_pull": Kind(
        {"reel_pull": 0.8, "reel_x": 1.0, "reel_y": 0.6},
        (_wheel("the cosine of the angle to a place", _reel, in_grammar=False),),
    ),
    "curvature_slip": Kind(
        {"curvature_slip": 0.055, "curvature_slip_scale": 1.0},
        (TrueLaw("yaw_rate", "w / (1 + c / (1 + k sqrt(abs(v / w))))", _scrubbing, in_grammar=False),),
    ),
    "coasting": Kind(
        {"coasting": 0.11},
        (
            _wheel(
                "psi where abs(u) < 0.01",
                lambda s, _p: s.psi * (np.abs(s.u) < 0.01),
                in_grammar=False,
            ),
        ),
    ),
    "slosh": Kind({"slosh": 0.025, "slosh_frequency": 1.2, "slosh_damping": 0.05}),
}
