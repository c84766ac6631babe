"""Laws local in time, space or frequency: their time, place or frequency is part of the search.

Vibrations appear as lines in the spectra of the white errors; times and places are tried on a grid over the range of
the drives and refined later.
"""

from collections.abc import Sequence

import numpy as np

from cmr.estimation.laws.candidates import Candidate
from cmr.estimation.laws.linearised import Linearised, is_of_wheels
from cmr.estimation.laws.rest import Rest
from cmr.model.laws.places import PLACES
from cmr.recordings.signal import Floats

MOMENTS = 11  # candidate start times
DISCS, RADII = 7, (0.08, 0.15, 0.3)  # centres of discs per axis, and radii as shares of the extent
FREQUENCIES = 8  # highest lines of a spectrum
SLOWEST, FASTEST = 0.3, 45.0  # Hz; range of vibrations searched
HIGH = 12.0  # times the mean of a spectrum: chance exceeds it once in 1e5
NEAR = 3  # lines that belong to one peak
BASES = {
    "wheel_voltage": ("s", "u", "1"),
    "wheel_slip": ("psi",),
    "encoder_rate": ("psi",),
    "forward_speed": ("v",),
    "yaw_rate": ("v", "w", "1"),
    "lateral_speed": ("v",),
    "gyro": ("1", "w"),
    "pose_theta": ("1",),
    "pose_ahead": ("1",),
    "pose_beside": ("1",),
}
SIZE = 4  # of a formula with a time, frequency or place, to account for their selection among many


def local_laws(model: Linearised, rest: Rest) -> list[Candidate]:
    """Return laws with a time, a place, or a frequency, for the residuals of a model."""
    laws = [*_of_moments(rest), *_of_places(model), *_of_frequencies(rest)]
    return [one for one in laws if model.shows(one)]


def _times(first: str, other: str) -> tuple[str, ...]:
    return (other,) if first == "1" else (first, other)


def _of_moments(rest: Rest) -> list[Candidate]:
    begin, end = float(rest.time.min()), float(rest.time.max())
    moments = np.linspace(begin, end, MOMENTS + 2)[1:-1]
    reach = {"moment": float(moments[1] - moments[0])}
    return [
        Candidate(place, _times(base, "step(t, moment)"), SIZE, constants={"moment": float(moment)}, reach=reach)
        for place, bases in BASES.items()
        for base in bases
        for moment in moments
    ]


def _of_places(model: Linearised) -> list[Candidate]:
    x, y = (np.concatenate([of.body[name] for of in model.variables]) for name in ("x", "y"))
    across = max(float(np.ptp(x)), float(np.ptp(y)), 1e-3)
    reach = dict.fromkeys(("east", "north"), across / DISCS) | {"radius": RADII[0] * across}
    centres = [
        (float(east), float(north))
        for east in np.linspace(x.min(), x.max(), DISCS + 2)[1:-1]
        for north in np.linspace(y.min(), y.max(), DISCS + 2)[1:-1]
    ]
    return [
        Candidate(
            place,
            _times(base, "disc(east, north, radius)"),
            SIZE,
            constants={"east": east, "north": north, "radius": share * across},
            reach=reach,
        )
        for place, bases in BASES.items()
        if not PLACES[place].of_sensors
        for base in bases[:1]
        for east, north in centres
        for share in RADII
    ]


def _of_frequencies(rest: Rest) -> list[Candidate]:
    """Return vibrations at the highest lines of the white errors' spectra, for every place visible in them."""
    reach = {"rate": 2.0 * np.pi / max(float(np.ptp(rest.time)), 1.0)}
    found = sorted({frequency for signal in np.unique(rest.signal) for frequency in _lines(rest, int(signal))})
    return [
        Candidate(
            place,
            _times(base, "sin(rate * t)"),
            SIZE,
            others=(_times(base, "cos(rate * t)"),),
            constants={"rate": 2.0 * np.pi * frequency},
            reach=reach,
        )
        for place, bases in BASES.items()
        for base in bases
        if base == "1" or not is_of_wheels(place)
        for frequency in found
    ]


def _lines(rest: Rest, signal: int) -> Sequence[float]:
    """Return the frequencies [Hz] of the highest lines of a signal's spectrum: those unlikely to arise by chance."""
    own = rest.signal == signal
    time, white = rest.time[own], rest.white[own]
    step = float(np.median(np.diff(time))) if len(time) > 2 else 0.0
    if step <= 0.0:
        return []
    number = np.round((time - time[0]) / step).astype(np.int64)
    grid: Floats = np.zeros(int(number.max()) + 1)
    grid[np.clip(number, 0, len(grid) - 1)] = white
    power = np.abs(np.fft.rfft(grid)) ** 2
    frequency = np.fft.rfftfreq(len(grid), step)
    power[(frequency < SLOWEST) | (frequency > FASTEST)] = 0.0
    usual = float(np.mean(power[power > 0.0])) if np.any(power > 0.0) else 0.0
    lines: list[float] = []
    while len(lines) < FREQUENCIES:
        best = int(np.argmax(power))
        if power[best] <= HIGH * usual:
            break
        lines.append(float(frequency[best]))
        power[max(0, best - NEAR) : best + NEAR + 1] = 0.0
    return lines
