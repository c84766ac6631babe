"""Motors and gearing: from the voltage to the wheel."""

from cmr.model.command_kinds import DUTY
from cmr.model.effect import Effect, Memory
from cmr.model.parameters import ParameterDefinition

GROUP = "motors and gearing"
STRIBECK_SPEED = 0.5  # rad/s at which the extra break-away friction has dropped to 1/e
HEATING_TIME = 60.0  # s, time constant with which motors warm up and cool down

COULOMB_FRICTION = Effect(
    name="coulomb_friction",
    group=GROUP,
    cause="Dry friction slows each wheel by {coulomb_friction:.2f} rad/s^2.",
    with_commands=(DUTY,),
    equations={
        "acceleration": """
            friction = friction + coulomb_friction
            break_away = break_away + coulomb_friction
        """
    },
    parameters=(
        # How dry friction depends on the speed differs between motors.
        ParameterDefinition(
            "coulomb_friction", "rad/s^2", "deceleration by dry friction", 0.0, 1e4, 0.0, 4.0, model_form_error=0.07
        ),
    ),
    needs="big steps in both directions",
    shows_in="wheel speeds, most where they change sign",
    confused_with={
        "quadratic_drag": "two speeds, both directions",
        "battery_sag": "slow ramps through zero",
        "static_friction": "slow ramps through zero",
    },
)

STATIC_FRICTION = Effect(
    name="static_friction",
    group=GROUP,
    cause="Starting from rest takes {static_friction:.1f} rad/s^2 more than rolling on.",
    with_commands=(DUTY,),
    equations={
        "acceleration": f"""
            friction = friction + static_friction * exp(-((psi / {STRIBECK_SPEED}) ** 2))
            break_away = break_away + static_friction
        """
    },
    # It fades while a wheel starts: depending on the Stribeck exponent, it appears up to 20 % smaller, and the motor
    # different. For robots with static friction of 11 to 16 % duty, k2_over_k3 was off by 1.1 to 1.4 %.
    parameters=(
        ParameterDefinition(
            "static_friction",
            "rad/s^2",
            "extra friction at rest",
            0.0,
            1e4,
            0.0,
            14.0,
            model_form_error=0.12,
            taken_for="k2_over_k3",
        ),
    ),
    needs="starts and reversals, slow ramps of the duty through zero",
    shows_in="wheel speeds at starts and reversals, and where a robot stays parked with a duty on",
    confused_with={"deadband": "ramps, multisine", "battery_sag": "big steps", "coulomb_friction": "slow ramps"},
)

QUADRATIC_DRAG = Effect(
    name="quadratic_drag",
    group=GROUP,
    cause="Drag grows with the square of the speed: {quadratic_drag:.3f} rad/s^2 at 1 rad/s.",
    with_commands=(DUTY,),
    equations={"acceleration": "acceleration = acceleration - quadratic_drag * psi * abs(psi)"},
    parameters=(
        ParameterDefinition("quadratic_drag", "1/rad", "deceleration per squared wheel speed", 0.0, 1e3, 0.0, 0.06),
    ),
    needs="two speeds that differ much",
    shows_in="wheel speeds, most at high speed",
    confused_with={"coulomb_friction": "two speeds"},
)

MOTOR_GAIN_ASYMMETRY = Effect(
    name="motor_gain_asymmetry",
    group=GROUP,
    cause="The {motor_gain_asymmetry:left/right} motor pulls harder: "
    "each side is {motor_gain_asymmetry:.1%} off the mean.",
    with_commands=(DUTY,),
    equations={"voltage": "voltage = voltage * (1.0 + side * motor_gain_asymmetry)"},
    parameters=(
        ParameterDefinition(
            "motor_gain_asymmetry",
            "-",
            "share by which the left motor pulls harder and the right one less",
            -0.5,
            0.5,
            0.0,
            0.03,
        ),
    ),
    needs="reversals",
    shows_in="wheel speeds, left against right",
    confused_with={"back_emf_asymmetry": "reversals", "wheel_radius_asymmetry": "look at the encoders"},
)

BACK_EMF_ASYMMETRY = Effect(
    name="back_emf_asymmetry",
    group=GROUP,
    cause="The {back_emf_asymmetry:left/right} motor runs slower: "
    "back-EMF constants are {back_emf_asymmetry:.1%} off the mean.",
    with_commands=(DUTY,),
    equations={"actuator": "back_emf = back_emf * (1.0 + side * back_emf_asymmetry)"},
    parameters=(
        ParameterDefinition(
            "back_emf_asymmetry",
            "-",
            "share by which K1 is larger on the left and smaller on the right",
            -0.5,
            0.5,
            0.0,
            0.03,
        ),
    ),
    needs="big steps",
    shows_in="wheel speeds, left against right",
    confused_with={"motor_gain_asymmetry": "big steps"},
)

MOTOR_HEATING = Effect(
    name="motor_heating",
    group=GROUP,
    cause="Motors slow down as they warm up: K1 rises by {motor_heating:.1%} at full drive.",
    with_commands=(DUTY,),
    equations={
        "actuator": "back_emf = back_emf * (1.0 + motor_heating * heat)",
        "memory": f"heat = duty * duty + (heat - duty * duty) * exp(-dt / {HEATING_TIME})",
    },
    parameters=(
        ParameterDefinition("motor_heating", "-", "share by which K1 rises at full drive", 0.0, 2.0, 0.0, 0.06),
    ),
    memory=(
        Memory(
            "heat",
            "-",
            f"squared duty, followed with a time constant of {HEATING_TIME:g} s",
            per_side=True,
            lasting=True,
        ),
    ),
    needs="minutes of effort, and pauses",
    shows_in="wheel speeds, following the effort of the last minute",
    confused_with={"battery_drift": "effort on one side only, idle pauses"},
)

MOTOR_COUPLING = Effect(
    name="motor_coupling",
    group=GROUP,
    cause="Accelerating one side {motor_coupling:pushes back/takes along} the other by {motor_coupling:.1%}: "
    "the robot is {motor_coupling:quicker/slower} to turn than to set off.",
    cause_of_speed="Accelerating one wheel {motor_coupling:pushes back/takes along} the other by {motor_coupling:.1%}: "
    "the robot follows a commanded turn {motor_coupling:sooner/later} than a commanded speed.",
    # Both sides at once: domega_L = f_L - c domega_R and domega_R = f_R - c domega_L. For a body of mass m and yaw
    # inertia J on wheels b apart, c = (m b^2 - 4 J) / (m b^2 + 4 J).
    equations={
        "coupling": """
            coupling = motor_coupling * free_left * free_right
            left = acceleration_left - coupling * acceleration_right
            right = acceleration_right - coupling * acceleration_left
            acceleration_left = left / (1.0 - coupling * coupling)
            acceleration_right = right / (1.0 - coupling * coupling)
        """
    },
    parameters=(
        ParameterDefinition(
            "motor_coupling", "-", "share of one side's acceleration that the other loses", -0.9, 0.9, 0.0, 0.15
        ),
    ),
    needs="steps of one side while the other is held",
    shows_in="the wheel speed of one side when the other is commanded",
    confused_with={"payload_change": "big steps on one side"},
)

BACKLASH = Effect(
    name="backlash",
    group=GROUP,
    cause="Gears have {backlash:.3f} rad of play.",
    equations={
        # The shaft moves within the gap before it takes the wheel along.
        "wheel": """
            moved = min(max(gap + turned, -0.5 * backlash), 0.5 * backlash)
            idle = (moved - gap) / dt
            gap = moved
        """,
        "ground": "rolling = rolling - idle",
    },
    parameters=(ParameterDefinition("backlash", "rad", "angle between both ends of the play", 0.0, 1.0, 0.0, 0.12),),
    memory=(Memory("gap", "rad", "where in the gap the shaft is; 0 is the middle", per_side=True),),
    needs="reversals",
    shows_in="pose and gyro at reversals, not in the encoders",
    confused_with={"longitudinal_slip": "spins both ways"},
)

PAYLOAD_CHANGE = Effect(
    name="payload_change",
    group=GROUP,
    cause="From {payload_change_time:.1f} s on the robot accelerates {payload_change_share:.1%} "
    "{payload_change_share:less/more}: its load changed.",
    with_commands=(DUTY,),
    equations={"actuator": "gain = gain * (1.0 - payload_change_share * after(payload_change_time))"},
    parameters=(
        ParameterDefinition("payload_change_share", "-", "share by which accelerations drop", -2.0, 0.95, 0.0, 0.25),
        ParameterDefinition(
            "payload_change_time", "s", "time of the change", 0.0, 1e6, 0.0, 60.0, switches=False, kind="time"
        ),
    ),
    needs="starts and reversals before and after",
    shows_in="wheel accelerations, from that time on",
    confused_with={"motor_coupling": "reversals before and after"},
)

EFFECTS = (
    COULOMB_FRICTION,
    STATIC_FRICTION,
    QUADRATIC_DRAG,
    MOTOR_GAIN_ASYMMETRY,
    BACK_EMF_ASYMMETRY,
    MOTOR_HEATING,
    MOTOR_COUPLING,
    BACKLASH,
    PAYLOAD_CHANGE,
)
