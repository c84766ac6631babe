"""A manoeuvre: a name, its purpose, the space it needs, and duties over time."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from cmr.geometry.manoeuvres.pieces import Duties, Piece, in_turn, rest
from cmr.model.body import turn
from cmr.model.parameters import RobotParameters

TYPICAL = RobotParameters(wheel_radius=0.04, k2_over_k3=118.0, k1=0.054, base_width=0.161)  # that of docs/effects.md
STILL = 1.0  # s at rest at both ends of each manoeuvre


@dataclass(frozen=True)
class Manoeuvre:
    """A named drive.

    `what` describes the drive, `good_for` its purpose, both in a few words that fit into a sentence. `space` [m] is how
    far the centre of a TYPICAL robot may get from its start, with a margin for less ideal robots. `gives` lists the
    motions that it contains, in the words of the catalogue of effects (`Effect.needs`, `Effect.confused_with`).
    `pieces` takes the time [s] of a full turn with sides that differ by a duty of 1.
    """

    name: str
    what: str
    good_for: str
    space: float
    gives: frozenset[str]
    pieces: Callable[[float], list[Piece]]

    def duties(self, robot: RobotParameters = TYPICAL, speed: float = 1.0) -> Duties:
        """Return the duties over time for a robot, multiplied by `speed`; they start and end at rest.

        Straight runs keep their durations, so their lengths go with the robot's top speed; circles last until the
        robot has turned.
        """
        turn_time = 2.0 * math.pi / float(turn(0.0, speed / robot.k1, robot))
        return in_turn([rest(STILL), *self.pieces(turn_time), rest(STILL)]).scaled(speed)

    def space_for(self, robot: RobotParameters, speed: float = 1.0) -> float:
        """Return the space [m] that another robot needs: it grows with the top speed and with the base width."""
        faster = speed * _top_speed(robot) / _top_speed(TYPICAL)
        wider = float(robot.base_width / TYPICAL.base_width)
        return self.space * max(faster, wider)


def _top_speed(robot: RobotParameters) -> float:
    return float(robot.wheel_radius / robot.k1)
