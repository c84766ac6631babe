"""What the plant may be told to drive: duties of both sides as functions of time."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import chain

import numpy as np

from cmr.plant.parameters import NEUTRAL, PlantParameters
from cmr.recordings.signal import Floats

REST = 2.0  # s before and after a figure-eight
SOFT = 1.0  # s in which a manoeuvre sets in
# Half the heading that a lobe of the figure turns through [rad]: the zero of the Bessel function J0, where the figure
# closes, because the mean of cos(A cos(phase)) is J0(A).
LOBE = 2.404825557695773

Manoeuvre = Callable[[Floats], tuple[Floats, Floats]]
Part = tuple[float, Manoeuvre]  # s, and what is driven in that time


def figure_eight(seconds: float, laps: int, speed: float = 0.3, robot: PlantParameters = NEUTRAL) -> Manoeuvre:
    """Return figure-eights at this speed [m/s] with rest before and after; the robot ends where it began.

    The yaw rate is a sine of the way, so the ideal robot of the parameters closes each figure.
    """
    moving = seconds - 2.0 * REST

    def duties(time: Floats) -> tuple[Floats, Floats]:
        since = np.clip(time - REST, 0.0, moving)
        envelope = soft(since, moving)
        phase = 2.0 * math.pi * laps * soft_way(since, moving) / soft_way(np.array(moving), moving)
        turn_rate = LOBE * 2.0 * math.pi * laps / (moving - SOFT) * np.sin(phase)
        common = speed * envelope / robot.wheel_radius
        difference = turn_rate * envelope * robot.base_width / 2.0 / robot.wheel_radius
        return robot.k1 * (common - difference), robot.k1 * (common + difference)

    return duties


def soft(since: Floats, duration: float) -> Floats:
    """Return what rises from 0 to 1 within SOFT and falls again before `duration`: squared sines."""
    rise = np.sin(0.5 * math.pi * np.clip(since / SOFT, 0.0, 1.0)) ** 2
    fall = np.sin(0.5 * math.pi * np.clip((duration - since) / SOFT, 0.0, 1.0)) ** 2
    envelope: Floats = rise * fall
    return envelope


def soft_way(since: Floats, duration: float) -> Floats:
    """Return the integral of `soft` from 0 [s]."""
    rising, falling = np.minimum(since, SOFT), np.maximum(since - (duration - SOFT), 0.0)
    flat = np.clip(since - SOFT, 0.0, duration - 2.0 * SOFT)
    over_pi = SOFT / math.pi / 2.0
    return (
        rising / 2.0
        - over_pi * np.sin(math.pi * rising / SOFT)
        + flat
        + falling / 2.0
        + over_pi * np.sin(math.pi * falling / SOFT)
    )


def in_turn(parts: Iterable[Part]) -> Manoeuvre:
    """Return manoeuvres one after the other, each for its duration [s]; time begins at 0 for each."""
    sequence = list(parts)

    def duties(time: Floats) -> tuple[Floats, Floats]:
        left, right, begin = np.zeros_like(time), np.zeros_like(time), 0.0
        for duration, part in sequence:
            here = (time >= begin - 1e-9) & (time < begin + duration - 1e-9)
            left[here], right[here] = part(time[here] - begin)
            begin += duration
        return left, right

    return duties


def constant(left: float, right: float) -> Manoeuvre:
    """Return a drive at constant duties."""
    return lambda time: (np.full_like(time, left), np.full_like(time, right))


def ramp(left: float, right: float, duration: float) -> Manoeuvre:
    """Return a slow ramp of both duties through zero: from minus to plus these values and back."""

    def duties(time: Floats) -> tuple[Floats, Floats]:
        share = 1.0 - np.abs(2.0 - 4.0 * time / duration)
        return left * share, right * share

    return duties


def multisine(left: float, right: float, size: float, lowest: float = 0.2, highest: float = 7.5) -> Manoeuvre:
    """Return sines of eight frequencies [Hz] at once, sign and share of each side given by `left` and `right`."""
    frequencies = np.geomspace(lowest, highest, 8)
    phases = math.pi * np.arange(8) ** 2 / 8.0  # low crest (Schroeder)

    def duties(time: Floats) -> tuple[Floats, Floats]:
        wave = size / 4.0 * np.sum(np.sin(2.0 * math.pi * frequencies * time[:, None] + phases), axis=1)
        return left * wave, right * wave

    return duties


def reversals(size: float, periods: Iterable[float] = (1.0, 2.0, 0.6)) -> Manoeuvre:
    """Return steps that stop, reverse and stop again, of both sides together and against each other."""
    parts = [(1.0, constant(0.0, 0.0))]
    for period in periods:
        for left, right in ((1.0, 1.0), (0.0, 0.0), (-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (0.5, 1.0), (-1.0, -0.5)):
            parts.append((period, constant(size * left, size * right)))
    return in_turn([*parts, (1.0, constant(0.0, 0.0))])


def _held(duration: float, *duties: tuple[float, float]) -> list[Part]:
    """Return these duties of left and right, each held for so long [s]."""
    return [(duration, constant(left, right)) for left, right in duties]


def _straight_runs() -> list[Part]:
    parts = []
    for duty in (0.25, 0.5, 0.85):
        parts += [*_held(1.6, (duty, duty), (-duty, -duty)), *_held(0.8, (0.0, 0.0))]
    return parts


def _spins() -> list[Part]:
    parts = []
    for duty in (0.12, 0.25, 0.45):
        parts += [*_held(2.5, (-duty, duty), (duty, -duty)), *_held(0.5, (0.0, 0.0))]
    return parts


def _circles() -> list[Part]:
    parts = []
    for inner, outer, duration in ((0.2, 0.3, 8.5), (0.35, 0.6, 5.0), (0.6, 0.75, 6.0)):
        parts += _held(duration, (inner, outer), (outer, inner))
    return parts


def _steps() -> list[Part]:
    of_one = ((0.9, 0.9), (-0.9, -0.9), (0.0, 0.0), (0.7, 0.0), (-0.7, 0.0), (0.0, 0.7), (0.0, -0.7))
    of_both = ((0.5, -0.5), (-0.5, 0.5), (0.4, 0.8), (-0.8, -0.4), (0.8, 0.4), (-0.4, -0.8))
    return _held(0.7, *of_one, *of_both)


# What tells effects apart, in the order of the rich drive.
PARTS: Mapping[str, Sequence[Part]] = {
    "straight_runs": _straight_runs(),
    "spins": _spins(),
    "ramps": [(8.0, ramp(0.25, 0.25, 8.0)), (8.0, ramp(-0.25, 0.25, 8.0))],
    "multisines": [(10.0, multisine(1.0, 1.0, 0.6)), (10.0, multisine(-1.0, 1.0, 0.4))],
    "circles": _circles(),
    "steps": _steps(),
}


def _between_rests(*names: str) -> list[Part]:
    """Return these of PARTS, one after the other, with rest at both ends."""
    return [*_held(3.0, (0.0, 0.0)), *chain.from_iterable(PARTS[name] for name in names), *_held(3.0, (0.0, 0.0))]


RICH_DRIVE_SECONDS = sum(duration for duration, _ in _between_rests(*PARTS))
PART_SECONDS = {name: sum(duration for duration, _ in _between_rests(name)) for name in PARTS}


def _held_out() -> list[Part]:
    """Return what differs from all parts of the rich drive: curves that wind, other radii, speeds and steps."""
    return [
        *_held(2.0, (0.0, 0.0)),
        *_held(2.0, (0.35, 0.35), (-0.35, -0.35)),
        (9.0, multisine(1.0, 0.55, 0.5, 0.15, 5.0)),
        (9.0, multisine(-0.5, 1.0, 0.5, 0.25, 6.0)),
        *_held(5.0, (0.3, 0.5), (0.5, 0.3)),
        *_held(3.5, (0.7, 0.55), (0.55, 0.7)),
        *_held(2.0, (-0.2, 0.2), (0.3, -0.3)),
        *_held(0.9, (0.8, 0.5), (-0.5, -0.8), (0.6, 0.0), (0.0, -0.6), (-0.7, 0.3), (0.3, -0.7)),
        *_held(2.0, (0.0, 0.0)),
    ]


HELD_OUT_SECONDS = sum(duration for duration, _ in _held_out())


def held_out_drive() -> Manoeuvre:
    """Return another drive than the rich one, on which models are judged; it takes HELD_OUT_SECONDS."""
    return in_turn(_held_out())


def rich_drive() -> Manoeuvre:
    """Return the drive that excites every effect; it takes RICH_DRIVE_SECONDS."""
    return in_turn(_between_rests(*PARTS))


def part_of_rich_drive(name: str) -> Manoeuvre:
    """Return one of PARTS by itself, with rest at both ends; it takes PART_SECONDS[name]."""
    return in_turn(_between_rests(name))
