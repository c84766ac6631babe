"""Sensors: from the true motion to the readings of encoders, gyro and external pose."""

from math import inf, pi

from cmr.model.command_kinds import DUTY
from cmr.model.effect import Effect
from cmr.model.parameters import ParameterDefinition

GROUP = "sensors"

ENCODER_SCALE = Effect(
    name="encoder_scale",
    group=GROUP,
    cause="Both encoders count {encoder_scale:.1%} {encoder_scale:more/fewer} ticks per turn than stated.",
    with_commands=(DUTY,),
    equations={"encoder": "reading = reading * (1.0 + encoder_scale)"},
    parameters=(
        ParameterDefinition("encoder_scale", "-", "share by which both encoders count more", -0.5, 1.0, 0.0, 0.02),
    ),
    needs="any motion, and commands or a pose from outside",
    shows_in="encoders against commands and pose",
    confused_with={"wheel_radius_scale": "none: the same mathematics, unless commands were recorded"},
    same_without={"wheel_radius": ("commands",)},
    rarity=20.0,  # encoder ticks are on a data sheet; unequal wheels are more common
    in_data_sheets=True,
)

ENCODER_ASYMMETRY = Effect(
    name="encoder_asymmetry",
    group=GROUP,
    cause="The {encoder_asymmetry:left/right} encoder counts more: each is {encoder_asymmetry:.1%} off the mean.",
    with_commands=(DUTY,),
    equations={"encoder": "reading = reading * (1.0 + side * encoder_asymmetry)"},
    parameters=(
        ParameterDefinition(
            "encoder_asymmetry",
            "-",
            "share by which the left encoder counts more, the right one less",
            -0.5,
            0.5,
            0.0,
            0.02,
        ),
    ),
    needs="any motion, and a pose from outside",
    shows_in="encoders against pose and against commands",
    confused_with={
        "wheel_radius_asymmetry": "compare wheels with commands: radii leave them in agreement",
        "motor_gain_asymmetry": "none: the same mathematics beside unequal wheels; turn both wheels by hand and "
        "compare their ticks",
    },
    # Encoder ticks are on a data sheet. Unequal motors together with unequal wheels look the same.
    rarity=20.0,
    in_data_sheets=True,
)

ENCODER_QUANTISATION = Effect(
    name="encoder_quantisation",
    group=GROUP,
    cause="Encoders are coarse: {encoder_quantisation:.0f} ticks per turn of the wheel.",
    equations={
        "encoder": """
            tick = 2.0 * pi / encoder_quantisation
            reading = where(tick > 0.0, floor(reading / tick) * tick, reading)
        """
    },
    parameters=(
        ParameterDefinition("encoder_quantisation", "ticks", "ticks per turn of the wheel", 1.0, inf, inf, 48.0),
    ),
    needs="any motion",
    shows_in="noise of the wheel speeds",
    confused_with={"deadband": "a finer encoder", "static_friction": "a finer encoder"},
    read_off=True,
)

# The common latency of all sensors is unknown: it counts as command_delay. If the gyro is ahead of the wheels, the
# earlier of gyro and poses is the reference, otherwise the wheels are: so no latency is negative.
WHEEL_SPEED_LATENCY = Effect(
    name="wheel_speed_latency",
    group=GROUP,
    cause="The wheels' readings are {wheel_speed_latency:.3f} s older than their stamps say.",
    equations={"encoder_time": "moment = moment - wheel_speed_latency"},
    parameters=(
        ParameterDefinition(
            "wheel_speed_latency",
            "s",
            "age of the wheels' readings at their stamp beside the gyro's; 0.2 from a filtered speed",
            0.0,
            1.0,
            0.0,
            0.1,
            kind="delay",
        ),
    ),
    needs="turns that begin and end, and a gyro",
    shows_in="the gyro, which is ahead of the wheels",
    confused_with={"command_delay": "a gyro: it shows how late the readings of the wheels are"},
    read_off=True,
)

GYRO_BIAS = Effect(
    name="gyro_bias",
    group=GROUP,
    cause="The gyro reads {gyro_bias:.4f} rad/s too {gyro_bias:high/low}.",
    equations={"gyro": "reading = reading + gyro_bias"},
    parameters=(ParameterDefinition("gyro_bias", "rad/s", "reading at rest", -1.0, 1.0, 0.0, 0.01),),
    needs="rest",
    shows_in="the gyro at rest",
    confused_with={"gyro_drift": "stand still at both ends"},
)

GYRO_SCALE = Effect(
    name="gyro_scale",
    group=GROUP,
    cause="The gyro reads {gyro_scale:.1%} too {gyro_scale:much/little} in turns.",
    equations={"gyro": "reading = reading + gyro_scale * yaw_rate"},
    parameters=(
        ParameterDefinition("gyro_scale", "-", "share by which turns are read too large", -0.5, 0.5, 0.0, 0.02),
    ),
    needs="turns",
    shows_in="the gyro in turns",
    confused_with={"turn_asymmetry": "turns both ways"},
)

GYRO_DRIFT = Effect(
    name="gyro_drift",
    group=GROUP,
    cause="The gyro drifts {gyro_drift:up/down} by {gyro_drift:.4f} rad/s in 100 s.",
    equations={"gyro": "reading = reading + gyro_drift * time / 100.0"},
    parameters=(ParameterDefinition("gyro_drift", "rad/s", "change of the bias in 100 s", -1.0, 1.0, 0.0, 0.012),),
    needs="rest at the beginning and at the end",
    shows_in="the gyro, slowly",
    confused_with={"gyro_bias": "stand still at both ends"},
)

GYRO_LATENCY = Effect(
    name="gyro_latency",
    group=GROUP,
    cause="The gyro is {gyro_latency:.3f} s {gyro_latency:late/early}.",
    equations={"gyro_time": "moment = moment - gyro_latency"},
    lateness_of="gyro",
    parameters=(
        ParameterDefinition("gyro_latency", "s", "age of a reading at its stamp", -0.5, 0.5, 0.0, 0.02, kind="delay"),
    ),
    needs="sudden turns",
    shows_in="the gyro where turns begin and end",
    confused_with={"longitudinal_slip": "spins"},
)

# A clock has a rate error, and latency is added to it, so stamps are corrected in this order.
CLOCK_SKEW = Effect(
    name="clock_skew",
    group=GROUP,
    cause="The clock of the pose runs {clock_skew:.3%} {clock_skew:fast/slow}.",
    equations={"pose_time": "moment = moment / (1.0 + clock_skew)"},
    parameters=(
        ParameterDefinition(
            "clock_skew",
            "-",
            "share by which the pose's clock runs fast",
            -0.1,
            0.1,
            0.0,
            5e-4,
            grows_with_interval=True,
        ),
    ),
    needs="a long drive",
    shows_in="the pose along the motion, growing with time",
    confused_with={"pose_latency": "a longer run"},
)

POSE_LATENCY = Effect(
    name="pose_latency",
    group=GROUP,
    cause="Poses are {pose_latency:.3f} s {pose_latency:older/younger} than their stamps say.",
    equations={"pose_time": "moment = moment - pose_latency"},
    lateness_of="poses",
    parameters=(
        ParameterDefinition(
            "pose_latency",
            "s",
            "age of a pose at its stamp; 0.2 from a slow lidar",
            -1.0,
            1.0,
            0.0,
            0.04,
            kind="delay",
            grows_with_interval=True,
        ),
    ),
    needs="changes of speed, and encoders",
    shows_in="the pose along the motion; it looks like a slow motor, but encoders against pose show it alone",
    confused_with={"electrical_lag": "compare encoders with pose", "clock_skew": "a longer run"},
    same_without={"command_delay": ("wheels", "gyro")},
)

POSE_SMOOTHING = Effect(
    name="pose_smoothing",
    group=GROUP,
    cause="The tracker smooths its poses with a time constant of {pose_smoothing:.3f} s.",
    equations={"pose_time": "filtered = filtered + pose_smoothing"},
    lateness_of="poses",
    parameters=(
        ParameterDefinition("pose_smoothing", "s", "time constant of the filter of the poses", 0.0, 0.35, 0.0, 0.1),
    ),
    needs="turns, and changes of speed",
    shows_in="the pose, late and to the inside of turns; it looks like late poses and smaller wheels",
    confused_with={"pose_latency": "faster turns", "wheel_radius_scale": "longer straight runs"},
    beside="pose_latency",
    rarity=6.0,  # late poses are more common than smoothed ones
)

POSE_OFFSET = Effect(
    name="pose_offset",
    group=GROUP,
    cause="The tracked point sits {pose_offset:.3f} m {pose_offset:ahead of/behind} the centre of rotation.",
    equations={
        "pose": """
            x = x + pose_offset * cos(theta)
            y = y + pose_offset * sin(theta)
        """
    },
    parameters=(
        ParameterDefinition("pose_offset", "m", "tracked point ahead of the turning centre", -5.0, 5.0, 0.0, 0.012),
    ),
    needs="spins on the spot",
    shows_in="the pose, sideways in turns",
    confused_with={"lateral_skid": "spins on the spot"},
)

# An effect of its own: beside pose_offset, it would cost that one a parameter where a drive hardly shows it.
POSE_OFFSET_LATERAL = Effect(
    name="pose_offset_lateral",
    group=GROUP,
    cause="The tracked point sits {pose_offset_lateral:.3f} m to the {pose_offset_lateral:left/right} of the centre of "
    "rotation.",
    equations={
        "pose": """
            x = x - pose_offset_lateral * sin(theta)
            y = y + pose_offset_lateral * cos(theta)
        """
    },
    parameters=(
        ParameterDefinition(
            "pose_offset_lateral", "m", "tracked point to the left of the turning centre", -5.0, 5.0, 0.0, 0.012
        ),
    ),
    needs="turns both ways",
    shows_in="the pose, along the motion in turns",
    confused_with={"travel_reduction": "turns both ways"},
)


def tracked_point(ahead: float, left: float) -> dict[str, float]:
    """Return the effects of a tracked point `ahead` and `left` (m) of the turning centre, each with its parameter.

    Both parameters have the names of their effects.
    """
    return {POSE_OFFSET.name: ahead, POSE_OFFSET_LATERAL.name: left}


# After the tracked point, whose position depends on the true heading.
POSE_HEADING_OFFSET = Effect(
    name="pose_heading_offset",
    group=GROUP,
    cause="The tracker is mounted askew: its heading points {pose_heading_offset:.3f} rad to the "
    "{pose_heading_offset:left/right} of straight ahead.",
    equations={"pose": "theta = theta + pose_heading_offset"},
    parameters=(
        ParameterDefinition(
            "pose_heading_offset",
            "rad",
            "measured heading less the true one",
            -2.0 * pi,
            2.0 * pi,
            0.0,
            0.05,
            kind="angle",
        ),
    ),
    needs="straight runs",
    shows_in="the pose, sideways on straight lines",
    confused_with={"pose_offset": "straight runs", "lateral_skid": "straight runs"},
)

POSE_DISTORTION = Effect(
    name="pose_distortion",
    group=GROUP,
    cause="The external pose stretches {pose_distortion:outwards/inwards}: "
    "by {pose_distortion:.1%} at 1 m from its origin.",
    equations={
        "pose": """
            stretch = 1.0 + pose_distortion * (x * x + y * y)
            x = x * stretch
            y = y * stretch
        """
    },
    parameters=(
        ParameterDefinition(
            "pose_distortion", "1/m^2", "stretch per squared distance", -1.0, 1.0, 0.0, 0.02, kind="stretch"
        ),
    ),
    needs="a large area",
    shows_in="the pose against place",
    confused_with={"wheel_radius_scale": "a larger area"},
    of_one_frame=True,
)

EFFECTS = (
    ENCODER_SCALE,
    ENCODER_ASYMMETRY,
    ENCODER_QUANTISATION,
    WHEEL_SPEED_LATENCY,
    GYRO_BIAS,
    GYRO_SCALE,
    GYRO_DRIFT,
    GYRO_LATENCY,
    CLOCK_SKEW,
    POSE_LATENCY,
    POSE_SMOOTHING,
    POSE_OFFSET,
    POSE_OFFSET_LATERAL,
    POSE_HEADING_OFFSET,
    POSE_DISTORTION,
)
