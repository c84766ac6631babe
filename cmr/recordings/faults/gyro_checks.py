"""Check the sign and scale of the gyro against poses and wheels.

A gyro that is mounted upside down, or reports degrees, measures the same motion up to a factor. This is neither a clock
fault nor an effect of the catalogue: such a gyro is excluded before clocks are compared.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from cmr.recordings.faults.findings import Finding
from cmr.recordings.rates import STEP, IncomparableError, Rates, common_rates, correlation_of
from cmr.recordings.recording import Recording
from cmr.recordings.travel import travel_of

FEWEST_SPANS = 10  # spans over which rates are averaged; fewer are not sufficient
# Largest residual of one sign relative to that of the other, at any lag of the clocks.
LEFT = 0.5
SMALLEST, LARGEST = 0.7, 1.4  # times the rotation of the poses; effects of a gyro are smaller
# Range of the robot's rotation relative to that implied by wheels without slip: tyre scrub reduces it, and the nominal
# base width may be wrong.
LEAST_TURN, MOST_TURN = 0.1, 10.0
SMALLEST_RATIO, LARGEST_RATIO = 0.01, 1.0  # wheel radius over base width, where they are not known; scrub included
DEGREES = math.degrees(1.0)
AS_GOOD_AS = 1.4  # factor on either side; this close to a unit's factor, the unit is the cause
OR_ELSE: Mapping[tuple[str, ...], str] = {
    ("poses",): ", or the poses are mirrored",
    ("wheels",): ", or encoders of the two sides are swapped (--swap)",
    ("commands",): ", or motors of the two sides are swapped (--swap)",
}


@dataclass(frozen=True)
class Comparison:
    """The gyro's rotation compared with another sensor's: `reverse`, and a factor from `least` to `most`.

    The unit is rad per unit of the other's turns.
    """

    reverse: bool
    least: float
    most: float

    @property
    def factor(self) -> float:
        """The middle of what the factor may be."""
        return math.sqrt(self.least * self.most)

    def times(self, factor: float) -> "Comparison":
        """Return the comparison for a gyro scaled by this factor."""
        return Comparison(self.reverse, factor * self.least, factor * self.most)

    def within(self, least: float, most: float) -> bool:
        """Return whether the factor may lie between these."""
        return self.most >= least and self.least <= most


def gyro_findings(recording: Recording) -> list[Finding]:
    """Find a gyro with a wrong sign or factor compared with poses and wheels.

    If these contradict each other, one of them is wrong, and the gyro is kept.
    """
    seen = _comparisons(recording)
    reverse = bool(seen) and all(one.reverse for one in seen.values())
    alike = [name for name, one in seen.items() if not one.reverse]
    wrong = _wrong_factor(recording, seen)
    everything = {"gyro": np.ones(len(recording.gyro), np.bool_)}
    return [
        Finding(
            "gyro_reversed",
            int(reverse),
            _about_sign(seen if reverse else alike, reverse),
            everything if reverse else {},
        ),
        Finding("gyro_factor", int(bool(wrong)), wrong or _sound(seen, "as far as"), everything if wrong else {}),
    ]


def _comparisons(recording: Recording) -> dict[str, Comparison]:
    """Compare the gyro's rotation with that of the poses, and of the wheels or else the commands, if possible."""
    others = ("poses", "wheels") if len(recording.wheels) > 1 else ("poses", "commands")
    present = [name for name in others if len(recording.signals[name]) > 1] if len(recording.gyro) > 1 else []
    origin = int(recording.pieces.first[0]) if present else 0
    compared = {}
    for name in present:
        gyro, other = (travel_of(recording, one, origin) for one in ("gyro", name))
        try:
            rates = common_rates(gyro, other, recording.pieces, origin)
        except IncomparableError:
            continue
        (pair,) = rates.pairs  # a gyro does not measure driving
        if np.count_nonzero(pair[0].covered & pair[1].covered) * STEP > FEWEST_SPANS * rates.span:
            compared[name] = _compared(*pair, rates.shifts)
    return {name: comparison for name, comparison in compared.items() if comparison}


def _compared(gyro: Rates, other: Rates, shifts: int) -> Comparison | None:
    """Compare two yaw rates, with clock offsets of up to `shifts` steps; None if they are not correlated.

    Both have errors: regressing the gyro on the other gives too small a factor, the reverse too large a one.
    """
    correlation, _ = correlation_of(gyro, other, shifts)
    best = int(np.argmax(np.abs(correlation)))
    alike = float(correlation[best])
    opposite = max(float(np.max(-math.copysign(1.0, alike) * correlation)), 0.0)
    if 1.0 - alike**2 > LEFT * (1.0 - opposite**2) or best in (0, 2 * shifts):
        return None
    late, early = slice(max(best - shifts, 0), None), slice(max(shifts - best, 0), None)
    both = [rates.values[at] for rates, at in ((gyro, late), (other, early))]
    covered = [rates.covered[at] for rates, at in ((gyro, late), (other, early))]
    count = min(map(len, both))
    common = covered[0][:count] & covered[1][:count]
    size = float(np.std(both[0][:count][common]) / np.std(both[1][:count][common]))
    return Comparison(alike < 0.0, abs(alike) * size, size / abs(alike))


def _wrong_factor(recording: Recording, seen: Mapping[str, Comparison]) -> str:
    """Return what is wrong with the gyro's factor; empty if nothing is, or if another sensor is at fault."""
    poses, wheels = seen.get("poses"), seen.get("wheels")
    turn = _turn_of_wheels(recording)
    if poses is None:
        return "" if wheels is None or wheels.within(*turn) else _about_wheels(wheels, turn)
    if poses.within(SMALLEST, LARGEST) or (wheels and not wheels.times(1.0 / poses.factor).within(*turn)):
        return ""
    return _about_poses(poses)


def _turn_of_wheels(recording: Recording) -> tuple[float, float]:
    """Return the range of the robot's rotation per unit of the wheels' rotation [rad]."""
    given = recording.parameters
    if given is None or not given.has("wheel_radius", "base_width"):
        return SMALLEST_RATIO, LARGEST_RATIO
    ratio = given.value("wheel_radius") / given.value("base_width")
    return LEAST_TURN * ratio, MOST_TURN * ratio


def _about_sign(seen: Iterable[str], reverse: bool) -> str:
    references = tuple(seen)
    if not reverse:
        return _sound(references, "the way")
    return (
        f"The gyro turns the other way than the {' and the '.join(references)}: it is mounted upside down "
        f"(--invert-gyro of cmr-driver){OR_ELSE.get(references, '')}. Its readings are set aside."
    )


def _about_poses(poses: Comparison) -> str:
    sentence = f"The gyro reports {poses.factor:.3g} times the turn of the poses"
    if poses.times(1.0 / DEGREES).within(1.0 / AS_GOOD_AS, AS_GOOD_AS):
        return f"{sentence}: it gives degrees per second, rad/s are wanted. Its readings are set aside."
    if poses.times(DEGREES).within(1.0 / AS_GOOD_AS, AS_GOOD_AS):
        return f"{sentence}, pi / 180: it, or the poses' heading, is not in rad. Its readings are set aside."
    return f"{sentence}: its scale is wrong, see to its unit (rad/s) and its range. Its readings are set aside."


def _about_wheels(wheels: Comparison, turn: tuple[float, float]) -> str:
    much = "more" if wheels.least > turn[1] else "less"
    return (
        f"The gyro reports far {much} than the wheels can turn the robot: see to its unit (rad/s), or to the encoders' "
        "ticks per turn. Its readings are set aside."
    )


def _sound(references: Iterable[str], how: str) -> str:
    named = " and the ".join(references)
    return f"The gyro turns {how} the {named} do." if named else "The gyro's turns have nothing to be compared with."
