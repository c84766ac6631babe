"""Which of a robot's effects each target carries, and why not the others: for the user, and for the documentation.

The Python file and the FMU step the model itself. The other targets have their own physics or none: the table says how
they carry an effect; effects not in the table are not carried.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum
from textwrap import fill
from typing import TYPE_CHECKING

from cmr.model.catalogue import CATALOGUE
from cmr.model.effect import GENERIC, LAWS, Effect
from cmr.model.stages import STAGES
from cmr.report.markup import Html
from cmr.report.section import paragraph
from cmr.report.table import table as html_table

if TYPE_CHECKING:
    from cmr.exporting.robot import ExportedRobot

PYTHON, FMU, MJCF, ROS2_CONTROL, SDF, URDF = TARGETS = ("python", "fmu", "mjcf", "ros2_control", "sdf", "urdf")
WHOLE_MODEL = (PYTHON, FMU)


class Carry(Enum):
    """How well a target carries an effect."""

    EXACTLY = "exactly"
    APPROXIMATELY = "approximately"
    NOT = "not"


@dataclass(frozen=True)
class Carried:
    """How well a target carries an effect, and by what means, or why not."""

    how: Carry
    why: str


def _exactly(why: str) -> Carried:
    return Carried(Carry.EXACTLY, why)


def _approximately(why: str) -> Carried:
    return Carried(Carry.APPROXIMATELY, why)


STEPS_THE_MODEL = _exactly("it steps the equations of the model")
BY_WEIGHT = ("longitudinal_slip", "lateral_skid")  # carried by Gazebo if the robot's mass is known
NO_MASS = Carried(Carry.NOT, "that takes the load on the wheels: give cmr-export the robot's mass")
NO_EFFECTS = "The robot has no effects: it moves by the model of the paper, four parameters."
YOUNGER = Carried(Carry.NOT, "its readings would show what has not happened yet; they show the present instead")
NOT_IN = {  # why an effect on the motion is not carried
    MJCF: "MuJoCo's motor, joints and contacts have nothing like it",
    ROS2_CONTROL: "the controller has no parameter for it",
    SDF: "Gazebo's systems have no parameter for it",
    URDF: "neither a URDF nor Gazebo's systems in it have a parameter for it",
}
OF_SENSORS = {
    MJCF: "the sensors of the file read the true motion",
    ROS2_CONTROL: "the sensors belong to the robot",
    SDF: "the file has no sensors",
    URDF: "the file has no sensors",
}
SPEED_LIMIT = "the largest speed and turn rate"
ACCELERATION_LIMIT = "the largest acceleration, of both wheels together"
PLUGIN = {
    "turn_rate_limit": _exactly("the largest turn rate"),
    "saturation": _approximately(SPEED_LIMIT),
    "slew_limit": _approximately(ACCELERATION_LIMIT),
    "current_limit": _approximately(ACCELERATION_LIMIT),
    "wheel_radius_scale": _exactly("the radius of the wheels"),
}
SLIP = "the WheelSlip system, whose slip grows with the wheel's speed: right at half the top speed"
GAZEBO = {
    **PLUGIN,
    "wheel_radius_asymmetry": _exactly("the radius of each wheel"),
    "wheel_separation_error": _exactly("the wheel separation that DiffDrive counts with"),
    "longitudinal_slip": _approximately(SLIP),
    "lateral_skid": _approximately(SLIP),
    "turn_slip": Carried(Carry.NOT, "wheels there do not slip in a steady turn, which nothing resists"),
}
BY_TARGET: dict[str, dict[str, Carried]] = {
    MJCF: {
        "command_delay": _approximately("a delay of each motor's command, in whole time steps"),
        "saturation": _exactly("the range of the command"),
        "current_limit": _exactly("the largest torque of each motor"),
        "electrical_lag": _approximately(
            "a filter of the command; where the current is limited, too, saturation comes first"
        ),
        "coulomb_friction": _approximately("frictionloss of the wheel joints, as hard as its constraint can be"),
        "quadratic_drag": _exactly("damping of the wheel joints that grows with the speed"),
        "motor_gain_asymmetry": _exactly("the stall torque and the no-load speed of each motor"),
        "back_emf_asymmetry": _exactly("the no-load speed of each motor"),
        "motor_coupling": _exactly("the yaw inertia of the body"),
        "slope": _approximately("gravity that is tilted, against which wheels hold sideways"),
        "wheel_radius_scale": _exactly("the radius of the wheels"),
        "wheel_radius_asymmetry": _exactly("the radius of each wheel"),
    },
    ROS2_CONTROL: {
        **PLUGIN,
        "wheel_radius_asymmetry": _exactly("left_wheel_radius_multiplier and right_wheel_radius_multiplier"),
        "wheel_separation_error": _exactly("wheel_separation_multiplier"),
    },
    SDF: GAZEBO,
    URDF: GAZEBO,
}


def carried(target: str, effect: Effect, is_younger: bool = False) -> Carried:
    """Return how well a target carries an effect; `is_younger`: the effect makes readings younger than their stamps."""
    if effect.group == LAWS and effect.is_sensor:
        return Carried(Carry.NOT, "a law of a sensor, which only CMR's own simulation has")
    if target in WHOLE_MODEL:
        return YOUNGER if is_younger else STEPS_THE_MODEL
    known = BY_TARGET[target].get(effect.name)
    if known is not None:
        return known
    if effect.group == LAWS:
        return Carried(Carry.NOT, "a law, which only the model has")
    if effect.group == GENERIC:
        return Carried(Carry.NOT, "a generic term, which only the model has")
    return Carried(Carry.NOT, (OF_SENSORS if effect.is_sensor else NOT_IN)[target])


def of_robot(target: str, robot: "ExportedRobot") -> dict[str, Carried]:
    """Return how well a target carries each effect of a robot, by its name."""
    found = {effect.name: carried(target, effect, _is_younger(effect, robot)) for effect in robot.effects}
    if target in (SDF, URDF) and robot.mass is None:
        found |= {name: NO_MASS for name in BY_WEIGHT if name in found}
    return found


def _is_younger(effect: Effect, robot: "ExportedRobot") -> bool:
    """Return whether an effect makes a sensor report a time later than its stamp, at the beginning or eventually."""
    for stage in effect.equations:
        if "moment" not in STAGES[stage].changes or effect.group == LAWS:
            continue
        for stamp in (0.0, 1e3):
            scope = {"moment": stamp, "time": stamp, "filtered": 0.0}
            scope |= {parameter.name: robot.value(parameter.name) for parameter in effect.parameters}
            exec(effect.equations[stage], {}, scope)
            if scope["moment"] > stamp:
                return True
    return False


def what_is_carried(target: str, robot: "ExportedRobot") -> list[str]:
    """Return lines that list which effects of a robot a target carries, how, and which it does not carry."""
    found = of_robot(target, robot)
    if not found:
        return [NO_EFFECTS]
    lines: list[str] = []
    sentences = dict(zip(found, robot.sentences, strict=True))
    for how in Carry:
        chosen = {name: one for name, one in found.items() if one.how is how}
        if chosen:
            lines += [f"Carried {how.value}:" if how is not Carry.NOT else "Not carried:"]
            lines += [line for name, one in chosen.items() for line in _entry(f"{name}: {sentences[name]}", one.why)]
    return lines


def _entry(sentence: str, why: str) -> Iterable[str]:
    reason = "" if why == STEPS_THE_MODEL.why else f" ({why})"
    text = fill(sentence + reason, 110, subsequent_indent="  ", break_on_hyphens=False)
    return ("* " + text).splitlines()


def effects_table(target: str, robot: "ExportedRobot") -> Html:
    """Return the same as a table of a page."""
    found = of_robot(target, robot)
    if not found:
        return paragraph(NO_EFFECTS)
    sentences = dict(zip(found, robot.sentences, strict=True))
    in_order = sorted(found.items(), key=lambda entry: [*Carry].index(entry[1].how))
    rows = [[name, one.how.value, one.why, sentences[name]] for name, one in in_order]
    return html_table(["effect", "carried", "how, or why not", "of this robot"], rows)


def table(target: str) -> str:
    """Return a Markdown table of the effects that a target carries."""
    rows = [(name, carried(target, effect)) for name, effect in CATALOGUE.items()]
    rows = [(name, one) for name, one in rows if one.how is not Carry.NOT]
    lines = [f"| `{name}` | {one.how.value} | {one.why} |" for name, one in rows]
    return "\n".join(["| effect | carried | how |", "|---|---|---|", *lines])
