"""Sign and scale of the gyro, by turning the robot round once by hand."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

from cmr.msg import gyro_t
from robot_driver.bringup.bench import Bench, CannotTell
from robot_driver.guided import Choice, Guide

STANDING = 3.0  # s at rest, for the gyro's bias
TURN = 360.0  # degrees
NEAR = 0.06  # share by which a manual turn may miss 360 degrees
SCALES = {1.0: "", 0.5: "180 degrees for a turn", 2.0: "720 degrees for a turn"}
STILL = 5.0  # degrees; less does not count as a turn
FEWEST = 20  # readings while standing
ROUNDS = 3
LONGEST_GAP = 0.2  # s between readings, over which a rate is held


@dataclass(frozen=True)
class GyroFound:
    """The gyro's mounting (upside down or not), and its scale for one turn; `present` is False if none answers."""

    present: bool
    inverted: bool = False
    scale: float = 1.0
    bias: float = 0.0  # rad/s, while standing

    @property
    def text(self) -> str:
        """The finding as text."""
        if not self.present:
            return "no gyro answers"
        words = f"the gyro counts {'clockwise' if self.inverted else 'counter-clockwise'}"
        return f"{words}, {TURN * self.scale:.0f} degrees for a turn"


def find_gyro(bench: Bench, guide: Guide) -> GyroFound:
    """Let the person turn the robot by hand; `bench` does not invert the gyro. Raises CannotTell."""
    guide.say("gyro.standing", "Put the robot on the floor and do not touch it for three seconds.")
    with bench.listening() as heard:
        for tenth in range(round(10 * STANDING)):
            bench.run(0.1)
            guide.progress(tenth / 10 / STANDING, "standing")
    rates = [reading.yaw_rate for reading in heard.gyro if reading.valid]
    if len(rates) < FEWEST:
        return _none(guide, len(heard.gyro))
    bias = sum(rates) / len(rates)
    earlier: list[GyroFound] = []
    for _ in range(ROUNDS):
        turned = _turned(bench, guide, bias)
        found = judged(turned, bias)
        if found == GyroFound(True, bias=bias):
            return found
        if found is None:
            guide.say("gyro.repeat", f"The gyro counted {turned:.0f} degrees, which is no whole turn. Once more.")
        elif found in earlier:
            if found.inverted and _which_way(guide) == "clockwise":
                guide.say("gyro.repeat", "Then it counts as it should, so far. Turn it counter-clockwise: to its left.")
            else:
                return found
        else:
            guide.say("gyro.again", f"The gyro counted {turned:.0f} degrees. Once more, to be sure.")
        if found is not None:
            earlier.append(found)
    raise CannotTell(
        "the gyro did not count the same for turns by hand. Turn the robot on one spot, from a mark back to the mark, "
        "slower than one turn in two seconds"
    )


def judged(turned: float, bias: float) -> GyroFound | None:
    """Return the gyro's properties from these degrees for one turn; None if nothing fits."""
    for scale in SCALES:
        if abs(abs(turned) / (TURN * scale) - 1.0) < NEAR:
            return GyroFound(True, turned < 0.0, scale, bias)
    return None


def _none(guide: Guide, marked: int) -> GyroFound:
    """Return the result for a robot without a gyro, if the person confirms it."""
    why = "says only readings that it marks as not valid" if marked else "says nothing"
    text = f"The gyro {why}. Is there to be one?"
    choices = Choice("none", "no, this robot has no gyro"), Choice("yes", "yes, it should be there")
    if guide.ask("gyro.none", text, choices) == "yes":
        raise CannotTell(f"the gyro {why}. Check its power, its cable and its baud rate (cmr bringup devices)")
    return GyroFound(False)


def _which_way(guide: Guide) -> str:
    text = "The gyro counted backward. Which way did you turn the robot, seen from above?"
    ways = Choice("left", "counter-clockwise, to the left"), Choice("clockwise", "clockwise, to the right")
    return guide.ask("gyro.direction", text, ways)


def _turned(bench: Bench, guide: Guide, bias: float) -> float:
    """Let the person turn the robot once; return the gyro's rotation (degrees)."""
    with bench.listening() as heard:
        guide.ask(
            "gyro.turn",
            "Turn the robot by hand, on the spot, counter-clockwise seen from above (to its left): one full turn, back "
            "to where it began, in about five seconds.",
            (Choice("done", "it has made one turn to the left"),),
        )
        bench.run(0.2)
    return math.degrees(angle_of(heard.gyro, bias))


def angle_of(readings: Sequence[gyro_t], bias: float) -> float:
    """Integrate the readings to a rotation (rad)."""
    valid = [reading for reading in readings if reading.valid]
    angle = 0.0
    for one, following in itertools.pairwise(valid):
        seconds = (following.utime - one.utime) / 1e6
        if 0.0 < seconds < LONGEST_GAP:
            angle += seconds * (0.5 * (one.yaw_rate + following.yaw_rate) - bias)
    return angle
