"""Parameters of the plant: the paper's robot and, for every effect, its parameters at their neutral values."""

import math
from collections.abc import Mapping, Sequence
from typing import Annotated, NamedTuple, TypeAlias, cast, get_type_hints

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]


class PlantParameters(NamedTuple):
    """One robot; by default a typical one of the paper's model, with every effect neutral.

    Each parameter is annotated with its least and largest value for which the plant's equations are valid.
    """

    wheel_radius: Annotated[float, (1e-3, 100.0)] = 0.04  # m
    k2_over_k3: Annotated[float, (1e-3, 1e6)] = 118.0  # rad/s^2
    k1: Annotated[float, (1e-6, 1e3)] = 0.054  # s/rad
    base_width: Annotated[float, (1e-3, 100.0)] = 0.161  # m
    # Battery and electronics.
    battery_sag: Annotated[float, (0.0, 0.5)] = 0.0  # 1, source resistance
    battery_drift: Annotated[float, (0.0, 1.0)] = 0.0  # 1, share of the voltage lost with the reference energy
    saturation: Annotated[float, (0.01, 1.0)] = 1.0  # duty
    current_limit: Annotated[float, (1e-3, math.inf)] = math.inf  # duty
    slew_limit: Annotated[float, (1e-3, math.inf)] = math.inf  # duty/s
    deadband: Annotated[float, (0.0, 1.0)] = 0.0  # duty
    command_delay: Annotated[float, (0.0, 10.0)] = 0.0  # s
    command_jitter: Annotated[float, (0.0, 10.0)] = 0.0  # s
    command_loss: Annotated[float, (0.0, 1.0)] = 0.0  # 1, probability
    turn_rate_limit: Annotated[float, (1e-3, math.inf)] = math.inf  # rad/s
    wheel_separation_error: Annotated[float, (-0.9, 10.0)] = 0.0  # 1
    electrical_lag: Annotated[float, (0.0, 10.0)] = 0.0  # s
    # Motors and gearing.
    coulomb_friction: Annotated[float, (0.0, 1000.0)] = 0.0  # rad/s^2
    static_friction: Annotated[float, (0.0, 1000.0)] = 0.0  # rad/s^2
    quadratic_drag: Annotated[float, (0.0, 10.0)] = 0.0  # 1/rad
    motor_gain_asymmetry: Annotated[float, (-0.9, 0.9)] = 0.0  # 1
    back_emf_asymmetry: Annotated[float, (-0.9, 0.9)] = 0.0  # 1
    motor_heating: Annotated[float, (-0.9, 10.0)] = 0.0  # 1
    motor_coupling: Annotated[float, (-0.9, 0.9)] = 0.0  # 1
    backlash: Annotated[float, (0.0, 6.3)] = 0.0  # rad
    payload_change_share: Annotated[float, (-10.0, 0.9)] = 0.0  # 1
    payload_change_time: Annotated[float, (0.0, math.inf)] = 0.0  # s
    # Wheels and ground.
    wheel_radius_scale: Annotated[float, (-0.9, 10.0)] = 0.0  # 1
    wheel_radius_asymmetry: Annotated[float, (-0.9, 0.9)] = 0.0  # 1
    wheel_wobble_share: Annotated[float, (-0.9, 0.9)] = 0.0  # 1
    wheel_wobble_phase: Annotated[float, (-6.3, 6.3)] = 0.0  # rad
    turn_slip: Annotated[float, (0.0, 10.0)] = 0.0  # s/rad
    turn_asymmetry: Annotated[float, (-0.9, 0.9)] = 0.0  # 1
    travel_reduction_share: Annotated[float, (0.0, 10.0)] = 0.0  # s/rad
    travel_reduction_saturation: Annotated[float, (0.0, 10.0)] = 0.0  # s/rad
    longitudinal_slip: Annotated[float, (0.0, 1.0)] = 0.0  # s
    lateral_skid: Annotated[float, (-10.0, 10.0)] = 0.0  # s
    slope_x: Annotated[float, (-1000.0, 1000.0)] = 0.0  # rad/s^2
    slope_y: Annotated[float, (-1000.0, 1000.0)] = 0.0  # rad/s^2
    surface_change_k1: Annotated[float, (-0.9, 10.0)] = 0.0  # 1
    surface_change_base_width: Annotated[float, (-0.9, 10.0)] = 0.0  # 1
    surface_change_time: Annotated[float, (0.0, math.inf)] = 0.0  # s
    surface_patch_friction: Annotated[float, (0.0, 1000.0)] = 0.0  # rad/s^2
    surface_patch_base_width: Annotated[float, (-0.9, 10.0)] = 0.0  # 1
    surface_patch_x: Annotated[float, (-1e4, 1e4)] = 0.0  # m
    surface_patch_y: Annotated[float, (-1e4, 1e4)] = 0.0  # m
    surface_patch_radius: Annotated[float, (0.0, 1e4)] = 0.4  # m
    # Sensors.
    encoder_scale: Annotated[float, (-0.9, 10.0)] = 0.0  # 1
    encoder_asymmetry: Annotated[float, (-0.9, 0.9)] = 0.0  # 1
    encoder_quantisation: Annotated[float, (1.0, math.inf)] = math.inf  # ticks per turn
    wheel_speed_latency: Annotated[float, (0.0, 10.0)] = 0.0  # s
    gyro_bias: Annotated[float, (-100.0, 100.0)] = 0.0  # rad/s
    gyro_scale: Annotated[float, (-10.0, 10.0)] = 0.0  # 1
    gyro_drift: Annotated[float, (-100.0, 100.0)] = 0.0  # rad/s in 100 s
    gyro_latency: Annotated[float, (0.0, 10.0)] = 0.0  # s
    pose_latency: Annotated[float, (0.0, 10.0)] = 0.0  # s
    pose_smoothing: Annotated[float, (0.0, 10.0)] = 0.0  # s
    clock_skew: Annotated[float, (-0.1, 0.1)] = 0.0  # 1
    pose_offset: Annotated[float, (-100.0, 100.0)] = 0.0  # m
    pose_offset_lateral: Annotated[float, (-100.0, 100.0)] = 0.0  # m
    pose_heading_offset: Annotated[float, (-6.3, 6.3)] = 0.0  # rad
    pose_distortion: Annotated[float, (-1.0, 1.0)] = 0.0  # 1/m^2
    # A controller inside that holds wheel speeds; the speed asked for by duty 1 is 1 / k1.
    controller_response_time: Annotated[float, (0.0, 100.0)] = 0.0  # s; 0 for a robot without
    controller_scale: Annotated[float, (0.01, 100.0)] = 1.0  # 1, speed reached of the one asked for
    controller_acceleration: Annotated[float, (1e-3, math.inf)] = math.inf  # rad/s^2
    controller_base_width: Annotated[float, (0.0, 100.0)] = 0.0  # m, by which it counts turns; 0 for its own base width
    # Other laws of friction than the effects': where it sets in smoothly, where it is larger at low speed.
    friction_smoothing: Annotated[float, (0.0, 1000.0)] = 0.0  # rad/s
    friction_bump: Annotated[float, (0.0, 1000.0)] = 0.0  # 1
    stribeck_shape: Annotated[float, (0.01, 100.0)] = 2.0  # 1
    viscous_friction: Annotated[float, (0.0, 1000.0)] = 0.0  # 1/s
    # Physics that no effect describes.
    cubic_motor: Annotated[float, (-1.0, 1.0)] = 0.0  # 1
    weak_reverse: Annotated[float, (-1.0, 1.0)] = 0.0  # 1
    torque_ripple: Annotated[float, (-1.0, 1.0)] = 0.0  # 1
    coasting: Annotated[float, (0.0, 1.0)] = 0.0  # 1
    caster_flip: Annotated[float, (-100.0, 100.0)] = 0.0  # rad/s
    traction_loss: Annotated[float, (0.0, 1000.0)] = 0.0  # 1/s
    side_wind: Annotated[float, (-100.0, 100.0)] = 0.0  # m/s
    side_wind_direction: Annotated[float, (-6.3, 6.3)] = 0.0  # rad
    floor_camber: Annotated[float, (-100.0, 100.0)] = 0.0  # rad/m
    encoder_miscount: Annotated[float, (0.0, 1.0)] = 0.0  # 1
    gyro_magnetism: Annotated[float, (-100.0, 100.0)] = 0.0  # rad/s
    pose_heading_warp: Annotated[float, (-6.3, 6.3)] = 0.0  # rad
    # Physics of the literature that no effect describes: see beyond_motors, beyond_ground and beyond_sensors.
    bridge_loss: Annotated[float, (0.0, 0.5)] = 0.0  # duty
    regeneration_limit: Annotated[float, (0.0, 10.0)] = 0.0  # duty; 0: none
    armature_reaction: Annotated[float, (0.0, 0.9)] = 0.0  # 1/duty
    winding_heat: Annotated[float, (-1.0, 10.0)] = 0.0  # 1/duty^2
    winding_heat_memory: Annotated[float, (0.01, 1e4)] = 12.0  # s
    battery_relaxation: Annotated[float, (0.0, 0.5)] = 0.0  # 1
    battery_relaxation_memory: Annotated[float, (0.01, 1e4)] = 8.0  # s
    gear_loss: Annotated[float, (0.0, 0.9)] = 0.0  # 1
    boundary_lubrication: Annotated[float, (0.0, 1000.0)] = 0.0  # rad/s^2
    boundary_lubrication_speed: Annotated[float, (0.1, 1000.0)] = 5.0  # rad/s
    bearing_drag: Annotated[float, (0.0, 1000.0)] = 0.0  # rad/s^2, at 1 rad/s
    brake_drag: Annotated[float, (0.0, 1000.0)] = 0.0  # rad/s^2
    cogging: Annotated[float, (-1000.0, 1000.0)] = 0.0  # rad/s^2
    cogging_phase: Annotated[float, (-6.3, 6.3)] = 0.0  # rad
    cross_coupling: Annotated[float, (-0.9, 10.0)] = 0.0  # 1
    turning_resistance: Annotated[float, (0.0, 1000.0)] = 0.0  # rad/s^2
    turning_resistance_rate: Annotated[float, (0.01, 100.0)] = 0.5  # rad/s
    mass_ahead: Annotated[float, (-10.0, 10.0)] = 0.0  # m
    floor_sag: Annotated[float, (-1000.0, 1000.0)] = 0.0  # rad/s^2 in a metre
    reel_pull: Annotated[float, (0.0, 1000.0)] = 0.0  # rad/s^2
    reel_x: Annotated[float, (-1e4, 1e4)] = 0.0  # m
    reel_y: Annotated[float, (-1e4, 1e4)] = 0.0  # m
    slosh: Annotated[float, (0.0, 0.9)] = 0.0  # 1, mass of the liquid that swings over that of the robot
    slosh_frequency: Annotated[float, (0.01, 20.0)] = 1.2  # Hz
    slosh_damping: Annotated[float, (0.0, 10.0)] = 0.05  # 1, of the critical one
    puncture: Annotated[float, (-0.9, 0.9)] = 0.0  # 1
    puncture_time: Annotated[float, (0.0, math.inf)] = 0.0  # s
    curvature_slip: Annotated[float, (0.0, 10.0)] = 0.0  # 1
    curvature_slip_scale: Annotated[float, (0.0, 100.0)] = 1.0  # 1
    understeer: Annotated[float, (0.0, 100.0)] = 0.0  # s^2/m^2
    slippery_spot: Annotated[float, (0.0, 0.9)] = 0.0  # 1
    slippery_spot_x: Annotated[float, (-1e4, 1e4)] = 0.0  # m
    slippery_spot_y: Annotated[float, (-1e4, 1e4)] = 0.0  # m
    slippery_spot_radius: Annotated[float, (0.0, 1e4)] = 0.4  # m
    breakaway_skid: Annotated[float, (-10.0, 10.0)] = 0.0  # s
    breakaway_skid_from: Annotated[float, (0.0, 100.0)] = 0.15  # m/s^2
    carpet_drift: Annotated[float, (0.0, 0.9)] = 0.0  # 1
    carpet_drift_direction: Annotated[float, (-6.3, 6.3)] = 0.0  # rad
    encoder_overspeed: Annotated[float, (0.0, 1.0)] = 0.0  # 1
    encoder_overspeed_from: Annotated[float, (0.0, 1e3)] = 7.0  # rad/s
    gyro_asymmetry: Annotated[float, (-1.0, 1.0)] = 0.0  # 1
    gyro_vibration: Annotated[float, (-100.0, 100.0)] = 0.0  # rad s/m^2
    gyro_warm_up: Annotated[float, (-100.0, 100.0)] = 0.0  # rad/s
    gyro_warm_up_memory: Annotated[float, (0.01, 1e4)] = 25.0  # s
    gyro_field: Annotated[float, (-100.0, 100.0)] = 0.0  # rad/s
    gyro_field_direction: Annotated[float, (-6.3, 6.3)] = 0.0  # rad
    lidar_imbalance: Annotated[float, (-100.0, 100.0)] = 0.0  # rad/s
    lidar_imbalance_frequency: Annotated[float, (0.01, 100.0)] = 5.5  # Hz
    lidar_imbalance_phase: Annotated[float, (-6.3, 6.3)] = 0.0  # rad
    body_roll: Annotated[float, (-10.0, 10.0)] = 0.0  # s^2
    pixel_aspect: Annotated[float, (-0.9, 10.0)] = 0.0  # 1
    compass_deviation: Annotated[float, (-6.3, 6.3)] = 0.0  # rad
    compass_deviation_direction: Annotated[float, (-6.3, 6.3)] = 0.0  # rad


NEUTRAL = PlantParameters()
RANGES: Mapping[str, tuple[float, float]] = {  # least and largest value, by name
    name: hint.__metadata__[0] for name, hint in get_type_hints(PlantParameters, include_extras=True).items()
}
# The one object for all records: compiled functions would compare a different one with it at every call, field by
# field.
_RECORD = np.dtype([(name, np.float64) for name in PlantParameters._fields])

# Typical sizes by effect. Times and places fit a drive of 40 s or more about the world's origin.
TYPICAL: Mapping[str, Mapping[str, float]] = {
    "battery_sag": {"battery_sag": 0.20},
    "battery_drift": {"battery_drift": 0.03},
    "saturation": {"saturation": 0.6},
    "current_limit": {"current_limit": 0.34},
    "slew_limit": {"slew_limit": 5.4},
    "deadband": {"deadband": 0.08},
    "command_delay": {"command_delay": 0.03},
    "command_jitter": {"command_jitter": 0.04},
    "command_loss": {"command_loss": 0.05},
    "turn_rate_limit": {"turn_rate_limit": 1.0},
    "wheel_separation_error": {"wheel_separation_error": 0.05},
    "electrical_lag": {"electrical_lag": 0.03},
    "coulomb_friction": {"coulomb_friction": 4.0},
    "static_friction": {"static_friction": 14.0},
    "quadratic_drag": {"quadratic_drag": 0.06},
    "motor_gain_asymmetry": {"motor_gain_asymmetry": 0.03},
    "back_emf_asymmetry": {"back_emf_asymmetry": 0.03},
    "motor_heating": {"motor_heating": 0.06},
    "motor_coupling": {"motor_coupling": 0.15},
    "backlash": {"backlash": 0.12},
    "payload_change": {"payload_change_share": 0.25, "payload_change_time": 18.0},
    "wheel_radius_scale": {"wheel_radius_scale": 0.02},
    "wheel_radius_asymmetry": {"wheel_radius_asymmetry": 0.015},
    "wheel_wobble": {"wheel_wobble_share": 0.04, "wheel_wobble_phase": 1.0},
    "turn_slip": {"turn_slip": 0.03},
    "travel_reduction": {"travel_reduction_share": 0.05, "travel_reduction_saturation": 0.0},
    "turn_asymmetry": {"turn_asymmetry": 0.03},
    "longitudinal_slip": {"longitudinal_slip": 0.02},
    "lateral_skid": {"lateral_skid": 0.06},
    "slope": {"slope_x": 1.0, "slope_y": -0.6},
    "surface_change": {"surface_change_k1": 0.05, "surface_change_base_width": 0.05, "surface_change_time": 18.0},
    "surface_patch": {
        "surface_patch_friction": 4.0,
        "surface_patch_base_width": 0.06,
        "surface_patch_x": 0.9,
        "surface_patch_y": 0.3,
        "surface_patch_radius": 0.4,
    },
    "encoder_scale": {"encoder_scale": 0.02},
    "encoder_asymmetry": {"encoder_asymmetry": 0.02},
    "encoder_quantisation": {"encoder_quantisation": 48.0},
    "wheel_speed_latency": {"wheel_speed_latency": 0.1},
    "gyro_bias": {"gyro_bias": 0.01},
    "gyro_scale": {"gyro_scale": 0.02},
    "gyro_drift": {"gyro_drift": 0.012},
    "gyro_latency": {"gyro_latency": 0.02},
    "pose_latency": {"pose_latency": 0.04},
    "pose_smoothing": {"pose_smoothing": 0.1},
    "clock_skew": {"clock_skew": 5e-4},
    "pose_offset": {"pose_offset": 0.012},
    "pose_offset_lateral": {"pose_offset_lateral": 0.012},
    "pose_heading_offset": {"pose_heading_offset": 0.05},
    "pose_distortion": {"pose_distortion": 0.02},
}


def plant_parameters(values: Mapping[str, float]) -> PlantParameters:
    """Return the typical robot with these values replaced.

    Raises TypeError naming a parameter that the plant does not have.
    """
    unknown = sorted(set(values) - set(PlantParameters._fields))
    if unknown:
        raise TypeError(f"the plant has no {', '.join(unknown)}")
    return PlantParameters(*(float(values.get(name, neutral)) for name, neutral in NEUTRAL._asdict().items()))


def as_record(parameters: PlantParameters) -> PlantParameters:
    """Return the parameters for compiled functions: one reference instead of a copy at every call."""
    return as_records(parameters)[0]


def as_records(parameters: PlantParameters) -> Sequence[PlantParameters]:
    """Return an array of one record: passing it from Python takes a twentieth of the time of the record.

    Compiled functions can use the record like the tuple: both have the same fields.
    """
    return cast("Sequence[PlantParameters]", np.array([tuple(parameters)], dtype=_RECORD))
