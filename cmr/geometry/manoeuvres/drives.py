"""The duties of each manoeuvre: functions from the robot's turn time to pieces of duty.

`turn_time` [s] is how long the robot takes for a full turn on which its sides differ by a duty of 1. No duty exceeds
0.9, which leaves real motors a reserve. Every motion is also driven in reverse, so that a real robot returns close to
its start without control.
"""

from collections.abc import Iterable
from itertools import chain, product

from cmr.geometry.manoeuvres.pieces import (
    BRISK,
    Piece,
    backwards,
    chirp,
    circle,
    forth_and_back,
    hold,
    multisine,
    ramp,
    rest,
    telegraph,
    turn_on_the_spot,
)

LEFT, RIGHT = 1.0, -1.0
COMMON, AGAINST = (1.0, 1.0), (-1.0, 1.0)
RAMP = 2.0  # s between zero duty and the peak of a ramp
RAMP_PEAK = 0.3  # duty; dry friction that holds a wheel is around 0.1, up to 0.14 on a small teaching robot
STANDSTILL = 30.0  # s
EFFORT = 60.0  # s of repeating the same loop between two pauses
IDLE = 20.0  # s; motors cool down by a quarter
STAR_LINES = 6


def straight_runs(_turn_time: float) -> list[Piece]:
    """Run forth and back at three speeds, the slow one over more than two turns of a small wheel."""
    return _straight_runs((0.2, 4.0), (0.45, 2.2), (0.85, 1.6))


def spins(_turn_time: float) -> list[Piece]:
    """Turn on the spot, left and right, at three rates."""
    return _spins(3.0)


def ramps(_turn_time: float) -> list[Piece]:
    """Let the duty rise and fall slowly through zero: both sides together, then against each other."""
    return [*_ramps(COMMON, 2), rest(), *_ramps(AGAINST, 2)]


def multisines(_turn_time: float) -> list[Piece]:
    """Drive many frequencies at once: both sides together, then against each other."""
    return [multisine(0.8, 0.8), rest(), multisine(-0.5, 0.5)]


def chirps(_turn_time: float) -> list[Piece]:
    """Drive rising frequencies, and the opposite, which leads back: both sides together, then against each other."""
    return _flat([piece, backwards(piece), rest()] for piece in (chirp(0.6, 0.6), chirp(-0.4, 0.4)))


def circles(turn_time: float) -> list[Piece]:
    """Drive circles of two radii, each at two speeds, left and right, forth and back."""
    return _circles(turn_time, (1.5, 0.4), (1.5, 0.9), (2.5, 0.5), (2.5, 0.9))


def figure_eights(turn_time: float) -> list[Piece]:
    """Drive a figure-eight forth and back slowly, then a wider one twice and fast, without a rest between.

    With the typical robot's top speed of 0.74 m/s that is half a minute at 0.2 m/s and half a minute at 0.5 m/s.
    """
    return [*_eight_and_back(turn_time, 1.5, 0.36), *(2 * _eight_and_back(turn_time, 2.0, 0.85)), rest()]


def steps(_turn_time: float) -> list[Piece]:
    """Start, reverse and stop at once, at three sizes and two lengths: both sides together, then against each other."""
    return _steps((0.9, 0.6, 0.3), (0.8, 0.4))


def one_sided_steps(_turn_time: float) -> list[Piece]:
    """Step one side forth and back while the other gets no duty, then while the other rolls; each side in turn."""
    return [*_one_sided(2), *_one_sided_rolling(2)]


def standstill(_turn_time: float) -> list[Piece]:
    """Stand still."""
    return [rest(STANDSTILL)]


def repeat_loop(turn_time: float) -> list[Piece]:
    """Drive the same figure-eight of two circles, forth and back, again and again, with two idle pauses."""
    loop = _circles(turn_time, (2.0, 0.75))
    seconds = sum(float(piece[-1, 0]) for piece in loop)
    effort = max(2, round(EFFORT / seconds)) * loop
    return [*effort, rest(IDLE), *effort, rest(IDLE), *effort]


def star(turn_time: float) -> list[Piece]:
    """Run out and back over one place in six directions."""
    out_and_back, turn = forth_and_back(0.6, 0.6, 4.0), turn_on_the_spot(1.0 / STAR_LINES, 0.2, turn_time)
    return STAR_LINES * [*out_and_back, *turn]


def rich_drive(turn_time: float) -> list[Piece]:
    """Drive a bit of everything: each part is shorter than in its own manoeuvre."""
    return [
        rest(2.0),
        *_straight_runs((0.25, 1.6), (0.5, 1.6), (0.85, 1.6)),
        *_spins(2.0),
        *_ramps(COMMON, 1),
        *_ramps(AGAINST, 1),
        rest(),
        *multisines(turn_time),
        *circle(1.5, 0.45, turn_time, LEFT),
        *_circles(turn_time, (1.5, 0.9)),
        *circle(2.5, 0.7, turn_time, RIGHT),
        *_steps((0.9, 0.5), (0.7,)),
        *_one_sided(1),
        rest(2.0),
    ]


def short_drive(turn_time: float) -> list[Piece]:
    """Drive short movements of all kinds and sizes, each forth and back; half of them rotated by a quarter turn."""
    quarter = turn_on_the_spot(0.25, 0.3, turn_time)
    return [
        rest(1.0),
        *_turned_round(0.25, 0.25, 0.6),
        *_turned_round(-0.25, 0.25, 0.6),
        *telegraph(0.6, 0.6),
        *telegraph(-0.5, 0.5),
        *_turned_round(0.9, 0.9, 0.7),
        *_turned_round(0.8, 0.4, 0.9),
        *_turned_round(0.0, 0.6, 1.0),
        rest(),
        *_ramps(COMMON, 1, 1.0),
        *quarter,
        *_ramps(AGAINST, 1, 1.0),
        *telegraph(0.7, 0.0),
        *telegraph(0.0, 0.7),
        *_turned_round(0.5, 0.5, 1.0),
        *_turned_round(-0.7, 0.7, 0.8),
        *_turned_round(0.4, 0.8, 0.9),
        *_turned_round(0.6, 0.0, 1.0),
        *_turned_round(0.3, 0.15, 1.5),
        *_turned_round(0.9, 0.9, 0.7),
        rest(2.0),
    ]


def _turned_round(left: float, right: float, seconds: float) -> list[Piece]:
    """Return a run at these duties, immediately followed by the same in reverse."""
    there = hold(left, right, seconds, BRISK)
    return [there, backwards(there)]


def _straight_runs(*runs: tuple[float, float]) -> list[Piece]:
    """Return runs forth and back, each given by its duty and the seconds of one way."""
    return _flat(forth_and_back(duty, duty, seconds) for duty, seconds in runs)


def _spins(seconds: float) -> list[Piece]:
    return _flat(forth_and_back(-duty, duty, seconds) for duty in (0.2, 0.35, 0.5))


def _ramps(sides: tuple[float, float], times: int, seconds: float = RAMP) -> list[Piece]:
    """Return ramps from zero up, through zero down, and back to zero; each takes `seconds` from zero to its peak."""
    left, right = (RAMP_PEAK * side for side in sides)
    return times * [ramp(left, right, seconds), ramp(-left, -right, 2.0 * seconds), ramp(0.0, 0.0, seconds)]


def _circles(turn_time: float, *circles: tuple[float, float]) -> list[Piece]:
    """Return circles, left and right, each given by its radius in base widths and the duty of its outer wheels."""
    return _flat(circle(radius, outer, turn_time, side) for radius, outer in circles for side in (LEFT, RIGHT))


def _eight_and_back(turn_time: float, radius: float, outer: float) -> list[Piece]:
    """Return a figure-eight of two circles and the same backwards, which returns to the start for any robot."""
    there = [circle(radius, outer, turn_time, side)[0] for side in (LEFT, RIGHT)]
    return [*there, *map(backwards, reversed(there))]


def _steps(sizes: Iterable[float], lengths: Iterable[float]) -> list[Piece]:
    return _flat(
        forth_and_back(left * size, right * size, seconds, BRISK)
        for (left, right), size, seconds in product((COMMON, AGAINST), sizes, lengths)
    )


def _one_sided(times: int) -> list[Piece]:
    left, right = forth_and_back(0.8, 0.0, 1.0, BRISK), forth_and_back(0.0, 0.8, 1.0, BRISK)
    return [*times * left, *times * right]


def _one_sided_rolling(times: int) -> list[Piece]:
    """Return steps of one side while the other rolls, and the same backwards."""
    rolling, steps = hold(0.4, 0.4, 0.6, BRISK), (hold(0.8, 0.4, 0.6, BRISK), hold(0.4, 0.8, 0.6, BRISK))
    forth = ([rolling, *times * [step, rolling]] for step in steps)
    return _flat([*part, *map(backwards, part), rest()] for part in forth)


def _flat(pieces: Iterable[list[Piece]]) -> list[Piece]:
    return list(chain.from_iterable(pieces))
