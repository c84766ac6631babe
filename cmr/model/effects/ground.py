"""Wheels and ground: from wheel rotation to the robot's motion."""

from cmr.model.command_kinds import DUTY
from cmr.model.effect import Effect
from cmr.model.parameters import ParameterDefinition

GROUP = "wheels and ground"

SLOPE = Effect(
    name="slope",
    group=GROUP,
    cause="The floor is not level: it slows the wheels by {slope_x:.2f} rad/s^2 on the way to {slope_x:+x/-x} and by "
    "{slope_y:.2f} rad/s^2 on the way to {slope_y:+y/-y}.",
    with_commands=(DUTY,),
    equations={"acceleration": "acceleration = acceleration - (slope_x * cosine + slope_y * sine)"},
    parameters=(
        ParameterDefinition("slope_x", "rad/s^2", "deceleration when heading along x", -1e3, 1e3, 0.0, 1.0),
        ParameterDefinition("slope_y", "rad/s^2", "deceleration when heading along y", -1e3, 1e3, 0.0, 1.0),
    ),
    needs="driving in all directions",
    shows_in="wheel speeds against heading",
    of_one_frame=True,
)

WHEEL_RADIUS_SCALE = Effect(
    name="wheel_radius_scale",
    group=GROUP,
    cause="Both wheels are {wheel_radius_scale:.1%} {wheel_radius_scale:larger/smaller} than stated.",
    equations={"ground": "radius = radius * (1.0 + wheel_radius_scale)"},
    parameters=(
        ParameterDefinition("wheel_radius_scale", "-", "share by which both wheels are larger", -0.5, 1.0, 0.0, 0.02),
    ),
    needs="any motion, and a pose from outside",
    shows_in="distances",
    confused_with={
        "encoder_scale": "none: the same mathematics, unless commands were recorded",
        "pose_distortion": "a larger area",
    },
    same_without={"wheel_radius": ("commands",)},
)

WHEEL_RADIUS_ASYMMETRY = Effect(
    name="wheel_radius_asymmetry",
    group=GROUP,
    cause="The {wheel_radius_asymmetry:left/right} wheel is the larger one: "
    "each is {wheel_radius_asymmetry:.2%} off the mean.",
    equations={"ground": "radius = radius * (1.0 + side * wheel_radius_asymmetry)"},
    parameters=(
        ParameterDefinition(
            "wheel_radius_asymmetry",
            "-",
            "share by which the left wheel is larger, the right smaller",
            -0.5,
            0.5,
            0.0,
            0.015,
        ),
    ),
    needs="straight runs",
    shows_in="the yaw rate, in proportion to the speed",
    confused_with={"turn_asymmetry": "straight runs", "encoder_asymmetry": "compare wheels with commands"},
)

WHEEL_WOBBLE = Effect(
    name="wheel_wobble",
    group=GROUP,
    cause="Wheels are out of round by {wheel_wobble_share:.1%} of their radius.",
    equations={"ground": "radius = radius * (1.0 + wheel_wobble_share * cos(angle + wheel_wobble_phase))"},
    parameters=(
        ParameterDefinition("wheel_wobble_share", "-", "share by which the radius swings", 0.0, 0.5, 0.0, 0.04),
        ParameterDefinition(
            "wheel_wobble_phase",
            "rad",
            "angle at the start past the largest radius",
            -7.0,
            7.0,
            0.0,
            0.7,
            switches=False,
            kind="angle",
        ),
    ),
    needs="slow driving, poses or gyro several times per wheel turn",
    shows_in="speed and yaw rate, once per turn of the wheel",
)

LONGITUDINAL_SLIP = Effect(
    name="longitudinal_slip",
    group=GROUP,
    cause="Wheels slip while they accelerate: the ground speed lags by {longitudinal_slip:.3f} s.",
    equations={"ground": "rolling = rolling - longitudinal_slip * domega"},
    parameters=(
        ParameterDefinition(
            "longitudinal_slip",
            "s",
            "slip per wheel acceleration",
            0.0,
            0.5,
            0.0,
            0.02,
            model_form_error=0.05,  # where motors run unevenly
        ),
    ),
    needs="big steps",
    shows_in="the pose at accelerations",
    confused_with={"gyro_latency": "big steps", "backlash": "spins both ways"},
    same_without={"command_delay": ("wheels",)},
    # Wheels that slip by k times their acceleration move the robot as if it followed them k later.
    seems_like=("gyro_latency", "pose_latency"),
)

TURN_ASYMMETRY = Effect(
    name="turn_asymmetry",
    group=GROUP,
    cause="The robot turns {turn_asymmetry:.1%} {turn_asymmetry:less/more} counter-clockwise and as much "
    "{turn_asymmetry:more/less} clockwise.",
    equations={"width": "width = width * (1.0 + turn_asymmetry * sign(difference))"},
    parameters=(
        ParameterDefinition(
            "turn_asymmetry",
            "-",
            "share by which the base width grows in counter-clockwise turns",
            -0.5,
            0.5,
            0.0,
            0.03,
        ),
    ),
    needs="turns both ways",
    shows_in="yaw, clockwise against counter-clockwise",
    confused_with={"wheel_radius_asymmetry": "spins", "turn_slip": "spins at several rates"},
    rarity=12.0,  # unequal wheels are more common
)

SURFACE_CHANGE = Effect(
    name="surface_change",
    group=GROUP,
    cause="The floor changes at {surface_change_time:.1f} s: K1 is {surface_change_k1:.1%} "
    "{surface_change_k1:larger/smaller} and the base width {surface_change_base_width:.1%} "
    "{surface_change_base_width:larger/smaller}.",
    equations={
        "actuator": "back_emf = back_emf * (1.0 + surface_change_k1 * after(surface_change_time))",
        "width": "width = width * (1.0 + surface_change_base_width * after(surface_change_time))",
    },
    parameters=(
        ParameterDefinition("surface_change_k1", "-", "share by which K1 grows", -0.9, 5.0, 0.0, 0.05),
        ParameterDefinition(
            "surface_change_base_width", "-", "share by which the base width grows", -0.9, 5.0, 0.0, 0.05
        ),
        ParameterDefinition(
            "surface_change_time", "s", "time of the change", 0.0, 1e6, 0.0, 60.0, switches=False, kind="time"
        ),
    ),
    needs="the same loop before and after",
    shows_in="everything, from that time on",
    confused_with={"battery_drift": "repeat the loop"},
)

SURFACE_PATCH = Effect(
    name="surface_patch",
    group=GROUP,
    cause="The floor differs within {surface_patch_radius:.2f} m of "
    "({surface_patch_x:+.2f} m, {surface_patch_y:+.2f} m): "
    "{surface_patch_friction:.1f} rad/s^2 of friction, base width {surface_patch_base_width:.1%} "
    "{surface_patch_base_width:larger/smaller}.",
    equations={
        # Distances inside the disc at the beginning and end of the step; the share of the step inside blends the change
        # in.
        "place": """
            begin = surface_patch_radius - sqrt((x - surface_patch_x) ** 2 + (y - surface_patch_y) ** 2)
            end = surface_patch_radius - sqrt((x_ahead - surface_patch_x) ** 2 + (y_ahead - surface_patch_y) ** 2)
            inside = share(begin, end)
        """,
        "acceleration": """
            friction = friction + surface_patch_friction * inside
            break_away = break_away + surface_patch_friction * inside
        """,
        "width": "width = width * (1.0 + surface_patch_base_width * inside)",
    },
    parameters=(
        ParameterDefinition(
            "surface_patch_friction", "rad/s^2", "friction inside", 0.0, 1e4, 0.0, 4.0, model_form_error=0.07
        ),
        ParameterDefinition(
            "surface_patch_base_width", "-", "share by which the base width grows inside", -0.9, 1.0, 0.0, 0.06
        ),
        ParameterDefinition(
            "surface_patch_x", "m", "centre of the disc", -1e6, 1e6, 0.0, 1.0, switches=False, kind="x"
        ),
        ParameterDefinition(
            "surface_patch_y", "m", "centre of the disc", -1e6, 1e6, 0.0, 0.5, switches=False, kind="y"
        ),
        ParameterDefinition(
            "surface_patch_radius", "m", "radius of the disc", 0.0, 1e3, 0.0, 0.4, switches=False, kind="radius"
        ),
    ),
    needs="crossing the place from several sides",
    shows_in="wheel speeds and yaw at one place",
    confused_with={"slope": "cross it from several sides", "deadband": "cross it from several sides"},
    of_one_frame=True,
)

TURN_SLIP = Effect(
    name="turn_slip",
    group=GROUP,
    cause="Wheels skid the more the faster the robot turns: the base width grows by {turn_slip:.1%} at 1 rad/s.",
    # yaw_rate (1 + k |yaw_rate|) is what the wheels ask for; this solves for yaw_rate.
    equations={"body": "yaw_rate = 2.0 * yaw_rate / (1.0 + sqrt(1.0 + 4.0 * turn_slip * abs(yaw_rate)))"},
    parameters=(
        ParameterDefinition(
            "turn_slip", "s/rad", "share by which the base width grows per yaw rate", 0.0, 10.0, 0.0, 0.03
        ),
    ),
    needs="spins at several rates; never accept it from one turn rate, it extrapolates badly",
    shows_in="the yaw rate, more at fast turns",
    confused_with={"turn_asymmetry": "spins at several rates", "turn_rate_limit": "spins at several rates"},
)

TRAVEL_REDUCTION = Effect(
    name="travel_reduction",
    group=GROUP,
    cause="Turning costs travel: the robot goes less far than its wheels turn, by {travel_reduction_share:.1%} times "
    "its yaw rate in rad/s while it turns slowly.",
    # Skid-steer robots travel nearly as far as their wheels turn on a straight line, and half as far in hard turns.
    equations={
        "body": """
            turns = abs(yaw_rate)
            lost = travel_reduction_share * turns / (1.0 + travel_reduction_saturation * turns)
            speed = speed * max(0.0, 1.0 - lost)
        """
    },
    parameters=(
        ParameterDefinition(
            "travel_reduction_share", "s/rad", "share of the travel lost per yaw rate; 0.5 on ice", 0.0, 5.0, 0.0, 0.05
        ),
        ParameterDefinition(
            "travel_reduction_saturation",
            "s/rad",
            "by how much less a fast turn costs than so many slow ones",
            0.0,
            10.0,
            0.0,
            0.0,
            switches=False,
        ),
    ),
    needs="circles at two speeds",
    shows_in="the pose's speed in turns, not the wheels'",
    confused_with={
        "wheel_radius_scale": "circles at two speeds",
        "pose_distortion": "circles at two speeds",
    },
)

LATERAL_SKID = Effect(
    name="lateral_skid",
    group=GROUP,
    cause="The robot skids outwards in turns: by {lateral_skid:.3f} s times speed times yaw rate.",
    equations={"body": "sideways = sideways - lateral_skid * speed * yaw_rate"},
    parameters=(
        ParameterDefinition(
            "lateral_skid", "s", "sideways speed per speed and yaw rate; 0.75 on ice", 0.0, 5.0, 0.0, 0.06
        ),
    ),
    needs="circles at two speeds",
    shows_in="sideways motion in fast turns",
    confused_with={"pose_offset": "circles at two speeds"},
)

EFFECTS = (
    SLOPE,
    WHEEL_RADIUS_SCALE,
    WHEEL_RADIUS_ASYMMETRY,
    WHEEL_WOBBLE,
    LONGITUDINAL_SLIP,
    TURN_ASYMMETRY,
    SURFACE_CHANGE,
    SURFACE_PATCH,
    TURN_SLIP,
    TRAVEL_REDUCTION,
    LATERAL_SKID,
)
