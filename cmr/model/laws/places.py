"""Places in the model where a law may act: the stage, the affected variable, and the variables it may read."""

from dataclasses import dataclass

from cmr.model.laws.words import VARIABLES

SIDES = ("both", "opposite", "left", "right")  # wheels on which a law of a wheel acts, and the sign
OF_BODY = ("v", "w", "theta", "x", "y", "t")
REMEMBERED = ("load", "charge", "since_turn", "way_since_turn")
OF_WHEEL = (*OF_BODY, "psi", "other_psi", "domega", "other_domega", "u", "other_u", "s", "effort", *REMEMBERED)


@dataclass(frozen=True)
class Place:
    """A place in the model: a law adds its formulas, times their coefficients, to `what`, which has a `unit`.

    `stage` is a stage of `cmr.model.stages`. `words` describes the quantity, after "A law changes". `variables` may be
    read; a law of a sensor has no memory.
    """

    stage: str
    unit: str
    what: str
    words: str
    shows_in: str
    variables: tuple[str, ...]
    per_side: bool = False

    @property
    def of_sensors(self) -> bool:
        """Whether a law there changes sensor readings but not the motion."""
        return self.stage in ("gyro", "pose", "pose_time")


def _of_body(what: str, unit: str, words: str) -> Place:
    return Place("body", unit, what, words, "the pose and the gyro", (*OF_BODY, "dv", "dw", *REMEMBERED))


def _of_wheel(stage: str, what: str, unit: str, words: str, shows_in: str) -> Place:
    return Place(stage, unit, what, words, shows_in, OF_WHEEL, per_side=True)


def _of_pose(what: str, unit: str, words: str) -> Place:
    return Place("pose", unit, what, words, "the pose", OF_BODY)


PLACES = {
    "wheel_acceleration": _of_wheel(
        "acceleration", "acceleration", "rad/s^2", "the acceleration of the wheels", "wheel speeds"
    ),
    "wheel_voltage": _of_wheel("voltage", "voltage", "-", "the voltage of the motors, as a duty", "wheel speeds"),
    "encoder_rate": _of_wheel(
        "wheel", "turned", "rad/s", "the speed that encoders count", "encoders against pose and gyro"
    ),
    "wheel_slip": _of_wheel(
        "ground", "rolling", "rad/s", "the speed of the tyres over the ground", "the pose and the gyro"
    ),
    "forward_speed": _of_body("speed", "m/s", "the forward speed"),
    "lateral_speed": _of_body("sideways", "m/s", "the speed to the left"),
    "yaw_rate": _of_body("yaw_rate", "rad/s", "the yaw rate"),
    "gyro": Place("gyro", "rad/s", "reading", "what the gyro reads", "the gyro", OF_BODY),
    "pose_x": _of_pose("x", "m", "the x of the poses"),
    "pose_y": _of_pose("y", "m", "the y of the poses"),
    "pose_theta": _of_pose("theta", "rad", "the heading of the poses"),
    "pose_ahead": _of_pose("ahead", "m", "where poses see the robot, ahead"),
    "pose_beside": _of_pose("beside", "m", "where poses see the robot, to the left"),
    "pose_lateness": Place("pose_time", "s", "moment", "the age of the poses", "the pose along the motion", ("t",)),
}
assert all(set(place.variables) <= set(VARIABLES) for place in PLACES.values())
