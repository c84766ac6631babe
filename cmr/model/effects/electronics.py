"""Battery and electronics: from the command to the motor."""

from math import inf

from cmr.model.command_kinds import DUTY, VELOCITY
from cmr.model.effect import Effect, Memory
from cmr.model.parameters import ParameterDefinition

GROUP = "battery and electronics"

COMMAND_DELAY = Effect(
    name="command_delay",
    group=GROUP,
    cause="Commands take effect {command_delay:.3f} s late.",
    equations={"packet": "delay = delay + command_delay"},
    parameters=(
        ParameterDefinition(
            "command_delay", "s", "time from a command to its effect", 0.0, 0.5, 0.0, 0.03, kind="delay"
        ),
    ),
    needs="commands that change often",
    shows_in="wheel speeds after every change of the command",
    confused_with={
        "electrical_lag": "multisine, reversals",
        "slew_limit": "reversals of different size",
        "command_jitter": "multisine: a delay leaves no spread",
    },
)

COMMAND_JITTER = Effect(
    name="command_jitter",
    group=GROUP,
    cause="Each command is late by a different time, of up to {command_jitter:.3f} s.",
    equations={"packet": "delay = delay + command_jitter * random"},
    parameters=(
        ParameterDefinition("command_jitter", "s", "largest additional delay of a command", 0.0, 0.5, 0.0, 0.04),
    ),
    needs="commands that change often",
    shows_in="the spread of wheel speeds after changes of the command, not their mean alone",
    confused_with={"command_delay": "multisine: a delay leaves no spread", "command_loss": "multisine"},
    by_chance=True,
    on_average={"command_delay": 0.5},
)

COMMAND_LOSS = Effect(
    name="command_loss",
    group=GROUP,
    cause="Of all commands {command_loss:.1%} are lost; the one before stays in force.",
    equations={"packet": "lost = lost | (random < command_loss)"},
    parameters=(ParameterDefinition("command_loss", "-", "probability that a command is lost", 0.0, 0.9, 0.0, 0.05),),
    needs="commands that change often",
    shows_in="single late changes of the wheel speed",
    confused_with={"command_jitter": "multisine"},
    by_chance=True,
)

TURN_RATE_LIMIT = Effect(
    name="turn_rate_limit",
    group=GROUP,
    cause="Commanded turns are limited to {turn_rate_limit:.2f} rad/s.",
    equations={
        "command": """
            counted_width = turn_rate_limit_base_width if turn_rate_limit_base_width > 0.0 else base_width
            turning = wheel_radius * (duty_right - duty_left) / (k1 * counted_width)
            excess = turning - min(max(turning, -turn_rate_limit), turn_rate_limit)
            duty_left = duty_left + excess * k1 * counted_width / (2.0 * wheel_radius)
            duty_right = duty_right - excess * k1 * counted_width / (2.0 * wheel_radius)
        """
    },
    parameters=(
        ParameterDefinition(
            "turn_rate_limit", "rad/s", "largest commanded yaw rate", 0.01, inf, inf, 1.0, kind="yaw_rate"
        ),
    ),
    # Software that converts (v, omega) to wheel speeds may use a different width than the effective one.
    given=(
        ParameterDefinition(
            "turn_rate_limit_base_width",
            "m",
            "base width by which commands count turns; 0 stands for the robot's own",
            0.0,
            1e2,
            0.0,
            0.0,
            switches=False,
        ),
    ),
    needs="commands for fast turns",
    shows_in="both wheel speeds while a fast turn is commanded",
    confused_with={"turn_slip": "spins at several rates"},
)

WHEEL_SEPARATION_ERROR = Effect(
    name="wheel_separation_error",
    group=GROUP,
    cause="Commanded turns reach the wheels {wheel_separation_error:.1%} {wheel_separation_error:larger/smaller}: the "
    "robot turns (v, omega) into wheel speeds with a wheel separation other than command_base_width.",
    equations={
        "command": """
            more = 0.5 * wheel_separation_error * (duty_right - duty_left)
            duty_left = duty_left - more
            duty_right = duty_right + more
        """
    },
    parameters=(
        ParameterDefinition(
            "wheel_separation_error",
            "-",
            "share by which the robot's wheel separation is larger than the one that commands are counted with",
            -0.9,
            5.0,
            0.0,
            0.05,
        ),
    ),
    needs="commands for straight runs and for turns",
    shows_in="wheel speeds, left against right, in proportion to the commanded turn rate",
    confused_with={"turn_rate_limit": "straight runs, spins at several rates"},
    with_commands=(VELOCITY,),
)

DEADBAND = Effect(
    name="deadband",
    group=GROUP,
    cause="Duties smaller than {deadband:.3f} do nothing.",
    with_commands=(DUTY,),
    equations={"actuator": "duty = duty if abs(duty) >= deadband else 0.0"},
    parameters=(
        ParameterDefinition(
            "deadband", "duty", "smallest duty that has an effect", 0.0, 0.9, 0.0, 0.08, kind="threshold"
        ),
    ),
    needs="slow ramps of the duty through zero",
    shows_in="wheel speeds near zero duty",
    confused_with={"static_friction": "slow ramps through zero", "encoder_quantisation": "a finer encoder"},
)

SLEW_LIMIT = Effect(
    name="slew_limit",
    group=GROUP,
    cause="The motor voltage changes by at most {slew_limit:.1f} of full drive in a second.",
    cause_of_speed="The commanded wheel speed changes by at most {slew_limit:.2f} rad/s^2.",
    equations={
        "start": "slewed = duty",
        # The mean over the step of a ramp at the limit that ends where the command is reached.
        "actuator": """
            reach = slew_limit * dt
            reached = min(max(duty, slewed - reach), slewed + reach)
            change = reached - slewed
            duty = reached - change * abs(change) / (2.0 * reach)
            slewed = reached
        """,
    },
    parameters=(
        ParameterDefinition(
            "slew_limit", "duty/s", "largest rate of change of the voltage", 0.05, inf, inf, 5.4, kind="acceleration"
        ),
    ),
    memory=(Memory("slewed", "duty", "voltage at the end of the step", per_side=True),),
    needs="steps and reversals of the command",
    shows_in="wheel speeds after steps of the command, the longer the larger the step",
    confused_with={
        "command_delay": "reversals of different size",
        "electrical_lag": "reversals of different size",
    },
)

ELECTRICAL_LAG = Effect(
    name="electrical_lag",
    group=GROUP,
    cause="The motor voltage follows its command with a lag of {electrical_lag:.3f} s.",
    cause_of_speed="The response is of second order: a second time constant is {electrical_lag:.3f} s.",
    equations={
        "start": "lagged = duty",
        # Exact: the end and the mean over the step of an exponential approach to the command.
        "actuator": """
            kept = exp(-dt / electrical_lag)
            ahead = lagged - duty
            lagged = duty + ahead * kept
            duty = duty + ahead * (1.0 - kept) * electrical_lag / dt
        """,
    },
    parameters=(ParameterDefinition("electrical_lag", "s", "time constant of the voltage", 0.0, 1.0, 0.0, 0.03),),
    memory=(Memory("lagged", "duty", "voltage at the end of the step", per_side=True),),
    needs="commands that change often",
    shows_in="wheel speeds after changes of the command",
    confused_with={"command_delay": "reversals", "slew_limit": "reversals of different size"},
    rarity=6.0,  # command delays are more common than a lag of 10 ms in small motors
)

BATTERY_SAG = Effect(
    name="battery_sag",
    group=GROUP,
    cause="The battery gives way under load: at a load share of 1 its voltage drops by {battery_sag:.1%}.",
    with_commands=(DUTY,),
    equations={"voltage": "voltage = voltage * (1.0 - battery_sag * load_share)"},
    parameters=(
        ParameterDefinition("battery_sag", "-", "share of the voltage lost per unit of load", 0.0, 0.9, 0.0, 0.20),
    ),
    needs="big steps and reversals",
    shows_in="wheel speeds under load, of both sides together",
    confused_with={"static_friction": "big steps", "saturation": "big steps"},
)

# Load share times seconds consumed in a drive of about two minutes at half speed.
ENERGY_OF_A_DRIVE = 10.0

BATTERY_DRIFT = Effect(
    name="battery_drift",
    group=GROUP,
    cause="The battery loses {battery_drift:.1%} of its voltage in a drive of two minutes.",
    with_commands=(DUTY,),
    equations={
        "voltage": f"voltage = voltage * (1.0 - battery_drift * energy / {ENERGY_OF_A_DRIVE})",
        "robot_memory": "energy = energy + load_share * dt",
    },
    parameters=(
        ParameterDefinition(
            "battery_drift",
            "-",
            f"share of the voltage lost when {ENERGY_OF_A_DRIVE:g} s of load share 1 are drawn",
            0.0,
            0.9,
            0.0,
            0.03,
        ),
    ),
    memory=(Memory("energy", "s", "load share, integrated over time", lasting=True),),
    needs="a drive of minutes",
    shows_in="wheel speeds, as a slow trend",
    confused_with={"motor_heating": "circles at two speeds, idle pauses", "surface_change": "repeat the loop"},
)

SATURATION = Effect(
    name="saturation",
    group=GROUP,
    cause="The motor voltage stops at {saturation:.2f} of full drive.",
    cause_of_speed="Commanded wheel speeds stop at {saturation:.2f} rad/s.",
    equations={"voltage": "voltage = min(max(voltage, -saturation), saturation)"},
    parameters=(ParameterDefinition("saturation", "duty", "largest voltage", 0.01, 1.0, 1.0, 0.6),),
    needs="commands near full drive",
    shows_in="wheel speeds at high duty only; a slow figure-eight does not show it",
    confused_with={"battery_sag": "big steps", "current_limit": "big steps"},
)

CURRENT_LIMIT = Effect(
    name="current_limit",
    group=GROUP,
    cause="The motor current is limited to {current_limit:.2f} of the current at rest and full drive.",
    cause_of_speed="Wheels accelerate by at most {current_limit_acceleration:.2f} rad/s^2, as where they lag their "
    "command by {current_limit:.2f} rad/s.",
    equations={"current": "current = min(max(current, -current_limit), current_limit)"},
    parameters=(
        ParameterDefinition(
            "current_limit", "duty", "largest motor current", 0.01, inf, inf, 0.34, kind="acceleration"
        ),
    ),
    needs="starts and reversals at high duty",
    shows_in="wheel accelerations at starts and reversals",
    confused_with={"saturation": "big steps", "slew_limit": "big steps"},
)

EFFECTS = (
    COMMAND_DELAY,
    COMMAND_JITTER,
    COMMAND_LOSS,
    TURN_RATE_LIMIT,
    WHEEL_SEPARATION_ERROR,
    DEADBAND,
    SLEW_LIMIT,
    ELECTRICAL_LAG,
    BATTERY_SAG,
    BATTERY_DRIFT,
    SATURATION,
    CURRENT_LIMIT,
)
