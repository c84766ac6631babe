"""The stages of the model's step, and the variables available to statements of effects in each.

The equations of effects consist of Python statements for these stages. A stage begins with the paper's value of its
variables, and statements change them, in the order of the catalogue. A stage for a side is written once and holds for
the left (`side` = 1.0) and for the right (`side` = -1.0); stages for the whole robot name the side: `duty_left`.
"""

from dataclasses import dataclass

ALWAYS = {
    "dt": "[s]",
    "time": "[s] since the start, at the step's beginning",
    "x": "[m] there",
    "y": "[m] there",
    "theta": "[rad] there",
}
FUNCTIONS = {
    "min": "of two",
    "max": "of two",
    "abs": "",
    "exp": "",
    "cos": "",
    "sin": "",
    "sqrt": "",
    "sign": "-1.0, 0.0 or 1.0",
    "after": "of a moment [s]: the share of the step that lies after it",
    "share": "of two values: the share of the step during which what goes from the one to the other is positive",
    "floor": "for sensors",
    "where": "for sensors",
    "inf": "for sensors",
    "pi": "for sensors",
}


@dataclass(frozen=True)
class Stage:
    """When a stage is computed, its variables with initial values, and the variables it reads."""

    when: str
    changes: dict[str, str]
    reads: dict[str, str]
    per_side: bool = False
    of_sensors: bool = False


ONCE, ENDS, POINTS, SENSOR = (
    "once a step",
    "at both ends of a step",
    "at the two Gauss points of a step",
    "when a sensor is read",
)
LOAD = {"load_share": "current drawn: sum over both sides of max(0, duty (duty - 0.8 K1 psi))"}
# `other_` refers to the wheel on the other side.
OTHER = {"other_psi": "", "other_domega": "", "other_duty": ""}
BEGUN = {**OTHER, "domega": "wheel acceleration where the step begins [rad/s^2]"}
WHEELS_OF_BOTH_SIDES = {
    "psi_left": "wheel speed [rad/s]",
    "psi_right": "wheel speed [rad/s]",
    "domega_left": "wheel acceleration [rad/s^2]",
    "domega_right": "wheel acceleration [rad/s^2]",
}
STAGES = {
    "start": Stage(
        "when a robot is placed",
        {},
        {"psi": "wheel speed [rad/s]", "duty": "the duty that holds it"},
        per_side=True,
    ),
    "packet": Stage(
        "once a step, for its command; reads its own and the paper's parameters only",
        {"delay": "age of the command in force [s]", "lost": "whether the command before stays in force"},
        {"random": "number in [0, 1), new for each step and effect"},
    ),
    "command": Stage(ONCE, {"duty_left": "command of the left side", "duty_right": "command of the right side"}, {}),
    "actuator": Stage(
        ONCE,
        {"duty": "mean over the step", "gain": "K2/K3 [rad/s^2]", "back_emf": "K1 [s/rad]"},
        {},
        per_side=True,
    ),
    "place": Stage(
        ONCE, {}, {"x_ahead": "where the step ends [m]", "y_ahead": "where the step ends [m]", **WHEELS_OF_BOTH_SIDES}
    ),
    "voltage": Stage(
        ENDS,
        {"voltage": "of the motor, as a duty"},
        {
            "duty": "",
            "psi": "wheel speed [rad/s]",
            **LOAD,
            **BEGUN,
        },
        per_side=True,
    ),
    "current": Stage(
        ENDS,
        {"current": "voltage - K1 psi, as a duty"},
        {"voltage": "", "psi": "", "back_emf": ""},
        per_side=True,
    ),
    "acceleration": Stage(
        ENDS,
        {
            "acceleration": "of the wheel without friction [rad/s^2]",
            "friction": "deceleration by friction while the wheel turns [rad/s^2]",
            "break_away": "acceleration that friction withstands at rest [rad/s^2]",
        },
        {"psi": "", "cosine": "of the heading", "sine": "of the heading", "duty": "", **LOAD, **BEGUN},
        per_side=True,
    ),
    "coupling": Stage(
        ENDS,
        {"acceleration_left": "with friction [rad/s^2]", "acceleration_right": "with friction [rad/s^2]"},
        {"free_left": "0.0 where the wheel sticks, else 1.0", "free_right": "the same of the right side"},
    ),
    "wheel": Stage(
        ONCE,
        {"turned": "angle by which the motor shaft turned, as its encoder counts it [rad]"},
        {"duty": "", "other_turned": "", **LOAD, **BEGUN},
        per_side=True,
    ),
    "ground": Stage(
        POINTS,
        {"radius": "of the wheel [m]", "rolling": "speed of the tyre over the ground [rad/s]"},
        {
            "psi": "",
            "domega": "wheel acceleration [rad/s^2]",
            "angle": "of the wheel since the start [rad]",
            "duty": "",
            **LOAD,
            **OTHER,
        },
        per_side=True,
    ),
    "width": Stage(
        POINTS,
        {"width": "base width [m]"},
        {"difference": "of the tyres' speeds over the ground, right minus left [m/s]"},
    ),
    "body": Stage(
        POINTS,
        {"speed": "forward [m/s]", "sideways": "to the left [m/s]", "yaw_rate": "[rad/s]"},
        {**WHEELS_OF_BOTH_SIDES, **LOAD},
    ),
    "memory": Stage(
        "at the end of a step",
        {},
        {"duty": "", "psi": "at the end", "domega": "at the end", **LOAD, **OTHER},
        per_side=True,
    ),
    "robot_memory": Stage("at the end of a step", {}, {**LOAD, **WHEELS_OF_BOTH_SIDES}),
    "encoder_time": Stage(
        SENSOR, {"moment": "that a stamped time shows [s]"}, {"time": "the stamp [s]"}, of_sensors=True
    ),
    "encoder": Stage(SENSOR, {"reading": "wheel angle [rad]"}, {"time": "[s]"}, per_side=True, of_sensors=True),
    "gyro_time": Stage(SENSOR, {"moment": "that a stamped time shows [s]"}, {"time": "the stamp [s]"}, of_sensors=True),
    "gyro": Stage(
        SENSOR,
        {"reading": "yaw rate [rad/s]"},
        {"time": "[s]", "yaw_rate": "the true one", "speed": "forward [m/s]"},
        of_sensors=True,
    ),
    "pose_time": Stage(
        SENSOR,
        {
            "moment": "that a stamped time shows [s]",
            "filtered": "time constant of the first-order filter through which the pose went before [s]",
        },
        {"time": "the stamp [s]"},
        of_sensors=True,
    ),
    "pose": Stage(
        SENSOR,
        {"x": "[m]", "y": "[m]", "theta": "[rad]"},
        {"time": "[s]", "yaw_rate": "the true one", "speed": "forward [m/s]"},
        of_sensors=True,
    ),
}
