"""Short movements, open loop: duties of both sides over 1 to 3 s, drawn again for each decision."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from cmr.model.duty_ramp import Limits, approach
from cmr.recordings.signal import Floats, Mask

PERIOD = 0.02  # s between two commands
FINE, LONGEST_RAMP = 0.01, 0.2  # s: between two duties on a ramp, and of the last one
SMALLEST, LARGEST = 0.067, 0.9  # duty: friction holds below, and real motors no longer obey above
OPENING, FASTER = 0.25, 0.5  # duty
REVERSAL = 0.24  # s
LENGTHS = (1.0, 1.5, 2.0, 3.0)  # s
HOLDS = (0.04, 0.08, 0.16)  # s for which a random telegraph signal holds
FREQUENCIES = (0.3, 7.5)  # Hz of multisines
SHARES = (1.0, 0.75, 0.5, 0.0, -0.5, -1.0)  # ratios of the inner side's duty to the outer side's
MOST_OF_SINES = 5
CANDIDATES = 90
ACROSS = 1.8  # factor on the distance to the middle for a movement to the other side
TOWARDS_SECONDS = (1.0, 1.5, 2.0)
Random = np.random.Generator
Profile = Callable[[Random, Floats, float], Floats]


@dataclass(frozen=True)
class Movement:
    """Duties of the left and the right side, shape (n, 2), each held for PERIOD, with a `name`."""

    name: str
    duty: Floats

    @property
    def seconds(self) -> float:
        """Its duration [s]."""
        return len(self.duty) * PERIOD

    @property
    def time(self) -> Floats:
        """The time of each command [s since the movement's beginning], (n,)."""
        return _raster(len(self.duty))


def ramped(time: Floats, duty: Floats, limits: Limits, begin: tuple[float, float]) -> tuple[Floats, Floats]:
    """Return the duties that a driver with these limits sends for commands at `time` [s], (n,), with `duty` (n, 2).

    It begins at the duties `begin`. Times are further apart than FINE; after each follow the steps of the ramp until
    the duty is reached. Commands that repeat the present duty are left out.
    """
    times: list[float] = []
    duties: list[tuple[float, float]] = []
    now, last = begin, float(time[-1]) + LONGEST_RAMP
    first = _changes(duty)
    begins = time[first].tolist()
    for moment, until, (left, right) in zip(begins, [*begins[1:], last], duty[first].tolist(), strict=True):
        while moment < until - 1e-6 and not (times and now == (left, right)):
            now = approach(now[0], left, FINE, limits), approach(now[1], right, FINE, limits)
            times.append(moment)
            duties.append(now)
            moment += FINE
    return np.array(times), np.array(duties)


def _changes(duty: Floats) -> Mask:
    """Return which rows of `duty` (n, 2) differ from the one before, the first one included, (n,)."""
    return np.concatenate([[True], np.any(duty[1:] != duty[:-1], axis=1)])


def opening() -> list[Movement]:
    """Return the first movement of every investigation: a rest, spins both ways, and straight on and back."""
    rest = Movement("rest", np.zeros((50, 2)))
    spins = Movement("spin both ways", _held((-OPENING, OPENING), (OPENING, -OPENING)))
    return [rest, spins, Movement("forth and back", _held((OPENING, OPENING), (-OPENING, -OPENING)))]


def waiting() -> Movement:
    """Return the movement on the spot during the first choice: reversals, faster than the opening."""
    left = np.tile(np.repeat((FASTER, -FASTER), _count(REVERSAL)), 2)
    return Movement("reversals, on the spot", np.stack([left, -left], axis=1))


def candidates(random: Random, count: int = CANDIDATES, least: float = 0.0) -> list[Movement]:
    """Return so many movements of random kinds, directions, sizes and lengths, of `least` [s] or longer."""
    lengths = _long_enough(LENGTHS, least)
    return [_drawn(random, lengths) for _ in range(count)]


def towards(distance: float, speed: float, random: Random, least: float = 0.0) -> list[Movement]:
    """Return straight and curved movements both ways that go about `distance` [m] at full duty's `speed` [m/s].

    They take `least` [s] or longer.
    """
    lengths = _long_enough(TOWARDS_SECONDS, least)
    result = []
    for share in (1.0, 0.75, 0.5):
        for mirrored in (False, True):
            seconds = float(random.choice(lengths))
            duty = float(np.clip(distance / (seconds * speed), SMALLEST, LARGEST))
            for signed in (duty, -duty, 0.5 * duty, min(ACROSS * duty, LARGEST)):
                sides = (share * signed, signed) if mirrored else (signed, share * signed)
                result.append(Movement("towards the middle", np.tile(sides, (_count(seconds), 1))))
    return result


def _long_enough(lengths: Sequence[float], least: float) -> Sequence[float]:
    """Return the lengths [s] that are not shorter than `least`; the longest one if all are."""
    return [one for one in lengths if one >= least] or [max(lengths)]


def _held(*sides: tuple[float, float]) -> Floats:
    """Return duties that are each held for half a second."""
    return np.repeat(np.array(sides), _count(0.5), axis=0)


def _raster(count: int) -> Floats:
    """Return so many times [s], PERIOD apart."""
    return np.arange(count, dtype=np.float64) * PERIOD


def _count(seconds: float) -> int:
    return round(seconds / PERIOD)


def _drawn(random: Random, lengths: Sequence[float]) -> Movement:
    """Draw one movement with one of these durations [s]."""
    time = _raster(_count(float(random.choice(lengths))))
    duty = float(np.exp(random.uniform(np.log(SMALLEST), np.log(LARGEST)))) * float(random.choice((-1.0, 1.0)))
    name = str(random.choice(list(KINDS)))
    if name == "rest":
        return Movement(name, np.zeros((len(time), 2)))
    share = float(random.choice(SHARES))
    common = KINDS[name](random, time, duty)
    if name in ("random telegraph", "multisine") and random.random() < 0.5:
        sides = np.stack([common, KINDS[name](random, time, duty)], axis=1)
        return Movement(f"{name} of each side", sides)
    inner = share * common
    if name == "S":  # curves one way, then the other
        half = time < 0.5 * (time[-1] + PERIOD)
        sides = np.stack([np.where(half, common, inner), np.where(half, inner, common)], axis=1)
    else:
        sides = np.stack([common, inner] if random.random() < 0.5 else [inner, common], axis=1)
    return Movement(f"{name}, {_direction(share)}", sides)


def _direction(share: float) -> str:
    return {1.0: "straight", -1.0: "on the spot", 0.0: "about one wheel"}.get(share, f"on an arc 1 : {share:g}")


def _constant(_random: Random, time: Floats, duty: float) -> Floats:
    return np.full(len(time), duty)


def _reversals(random: Random, time: Floats, duty: float) -> Floats:
    half = float(random.uniform(0.2, 0.75))
    return np.where(np.floor(time / half) % 2 == 0, duty, -duty)


def _ramp(_random: Random, time: Floats, duty: float) -> Floats:
    return np.asarray(duty * (1.0 - 2.0 * time / time[-1]))


def _step_and_stop(random: Random, time: Floats, duty: float) -> Floats:
    return np.where(time < random.uniform(0.3, 0.7) * time[-1], duty, 0.0)


def _telegraph(random: Random, time: Floats, duty: float) -> Floats:
    hold = _count(float(random.choice(HOLDS)))
    signs = random.choice((-1.0, 1.0), size=len(time) // hold + 1)
    return np.asarray(duty * np.repeat(signs, hold)[: len(time)])


def _multisine(random: Random, time: Floats, duty: float) -> Floats:
    count = int(random.integers(2, MOST_OF_SINES + 1))
    slowest, fastest = (math.log(one) for one in FREQUENCIES)
    rates = np.exp(random.uniform(slowest, fastest, size=count))
    waves = np.sin(2.0 * np.pi * rates * time[:, None] + random.uniform(0.0, 2.0 * np.pi, size=count))
    total = waves.sum(axis=1)
    return np.asarray(duty * total / np.max(np.abs(total)))


KINDS: dict[str, Profile] = {
    "constant": _constant,
    "reversals": _reversals,
    "ramp through zero": _ramp,
    "step and stop": _step_and_stop,
    "random telegraph": _telegraph,
    "multisine": _multisine,
    "S": _constant,
    "rest": _constant,
}
