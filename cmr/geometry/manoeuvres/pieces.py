"""Building blocks of manoeuvres: pieces of duty over time, piecewise linear between knots.

A piece is an array of shape (n, 3) of knots: time [s] since the beginning of the piece, above 0 and increasing, and
the duties of both sides. Its last knot is its end. It begins wherever the piece before it ended.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TypeAlias, overload

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]
Piece: TypeAlias = Floats

GENTLE = 0.3  # s to go from one duty to another
BRISK = 0.05  # s; still a step for a motor whose time constant is 0.16 s, and gentle to its gears
PAUSE = 0.8  # s at zero duty, after which such a motor has stopped
SOFT = 0.5  # s in which a multisine fades in and out
KNOTS = 200.0  # Hz, of a multisine and a chirp
# Multiples of 0.1 Hz, so that all are periodic in 10 s and the robot is then where it began.
FREQUENCIES = np.array([0.2, 0.3, 0.6, 1.0, 1.6, 2.7, 4.5, 7.5])  # Hz
PERIOD = 10.0  # s
LOWEST, HIGHEST = 0.25, 4.0  # Hz, of a chirp
SIGNS = (
    1,
    1,
    1,
    1,
    -1,
    1,
    -1,
    1,
    1,
    -1,
    -1,
    1,
    -1,
    -1,
    -1,
)  # x^4 + x + 1
HELD = 0.12  # s; shortest time for which a sign is held


@dataclass(frozen=True)
class Duties:
    """Duties of both sides over time: knots with straight lines between them, each of shape (n,), `time` in [s]."""

    time: Floats
    left: Floats
    right: Floats

    @property
    def duration(self) -> float:
        """How long they last [s]."""
        return float(self.time[-1])

    @overload
    def at(self, time: float) -> tuple[np.float64, np.float64]: ...

    @overload
    def at(self, time: NDArray[np.floating]) -> tuple[Floats, Floats]: ...

    def at(self, time: float | NDArray[np.floating]) -> tuple[np.float64 | Floats, np.float64 | Floats]:
        """Return the duties (left, right) at times [s]; before the beginning and after the end they are zero."""
        return np.interp(time, self.time, self.left), np.interp(time, self.time, self.right)

    def scaled(self, speed: float) -> "Duties":
        """Return them with all duties multiplied by `speed`."""
        return Duties(self.time, speed * self.left, speed * self.right)


def in_turn(pieces: Iterable[Piece]) -> Duties:
    """Concatenate pieces, starting from zero duty."""
    knots, end = [np.zeros((1, 3))], 0.0
    for piece in pieces:
        knots.append(piece + np.array([end, 0.0, 0.0]))
        end += piece[-1, 0]
    return Duties(*np.concatenate(knots).T)


def hold(left: float, right: float, seconds: float, transition: float = GENTLE) -> Piece:
    """Return a piece that goes to these duties within `transition` [s] and holds them until `seconds` have passed."""
    return np.array([(min(transition, 0.5 * seconds), left, right), (seconds, left, right)])


def rest(seconds: float = PAUSE, transition: float = GENTLE) -> Piece:
    """Return a piece at zero duty."""
    return hold(0.0, 0.0, seconds, transition)


def forth_and_back(left: float, right: float, seconds: float, transition: float = GENTLE) -> list[Piece]:
    """Return a run at these duties, the same backwards, and a pause; each run takes `seconds`.

    A robot that moves symmetrically forth and back is then at its start, whatever its parameters.
    """
    there, back = hold(left, right, seconds, transition), hold(-left, -right, seconds, transition)
    return [there, back, rest(PAUSE, transition)]


def backwards(piece: Piece) -> Piece:
    """Return a piece with the opposite duties."""
    return np.multiply(piece, (1.0, -1.0, -1.0))


def ramp(left: float, right: float, seconds: float) -> Piece:
    """Return a straight ramp to these duties."""
    return np.array([(seconds, left, right)])


def multisine(left: float, right: float) -> Piece:
    """Return PERIOD seconds of a sum of sines of all FREQUENCIES; `left` and `right` are the peaks, with sign."""
    time = _knots()
    count = len(FREQUENCIES)
    phases = math.pi * np.arange(count) ** 2 / count  # Schroeder's: peaks hardly higher than those of one sine
    wave = np.sin(2.0 * math.pi * FREQUENCIES * time[:, None] + phases).sum(axis=1)
    wave *= _soft_ends(time)
    wave /= np.abs(wave).max()
    return np.column_stack([time, left * wave, right * wave])


def telegraph(left: float, right: float) -> list[Piece]:
    """Return duties that switch sign at irregular times, followed by the same in reverse.

    The signs are a maximum length sequence, with a flat spectrum up to the frequency of HELD. `left` and `right` are
    the duties, with sign.
    """
    return [hold(sign * left, sign * right, HELD, BRISK) for sign in (*SIGNS, *(-one for one in reversed(SIGNS)))]


def chirp(left: float, right: float) -> Piece:
    """Return PERIOD seconds of a sine whose frequency rises from LOWEST to HIGHEST, by the same factor each second.

    `left` and `right` are the peaks, with sign.
    """
    time = _knots()
    octaves = math.log(HIGHEST / LOWEST)
    turns = LOWEST * PERIOD / octaves * np.expm1(octaves * time / PERIOD)
    wave = np.sin(2.0 * math.pi * turns) * _soft_ends(time)
    return np.column_stack([time, left * wave, right * wave])


def _knots() -> Floats:
    """Return the times [s] of the knots of PERIOD seconds."""
    return np.arange(1, round(PERIOD * KNOTS) + 1) / KNOTS


def _soft_ends(time: Floats) -> Floats:
    """Return factors that rise from 0 to 1 in SOFT seconds, and fall again before PERIOD is over."""
    share = np.clip(np.minimum(time, PERIOD - time) / SOFT, 0.0, 1.0)
    return np.asarray(np.sin(0.5 * math.pi * share) ** 2)


def circle(radius: float, outer: float, turn_time: float, side: float) -> list[Piece]:
    """Return a full circle, to the left with `side` 1.0, to the right with -1.0, the same backwards, and a pause.

    `radius` is in base widths, `outer` the duty of the outer wheels; `turn_time` [s] is how long the robot takes for
    a full turn on which its sides differ by a duty of 1.
    """
    inner = outer * (2.0 * radius - 1.0) / (2.0 * radius + 1.0)
    left, right = (inner, outer) if side > 0.0 else (outer, inner)
    return forth_and_back(left, right, turn_time / (outer - inner))


def turn_on_the_spot(turns: float, duty: float, turn_time: float) -> list[Piece]:
    """Return a turn to the left by so many full turns, and a pause; `turn_time` as for `circle`."""
    return [hold(-duty, duty, turns * turn_time / (2.0 * duty)), rest()]
