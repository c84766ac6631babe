"""Rows of calibration: the grid search and the refinement of a 120 s drive with 12,000 positions."""

import statistics
import time
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import TypeVar

import numpy as np

from benchmarks.drive import TRUTH, recording
from benchmarks.report import Row, seconds
from benchmarks.timing import Timing
from cmr.calibration.grid import minimum, search
from cmr.calibration.refine import Refined, Refinement
from cmr.calibration.segments import Segment, segments_of
from cmr.recordings.recording import Floats

T = TypeVar("T")
NAMES = ("k2_over_k3", "k1", "base_width")
SAMPLES = 12_000
SECONDS = SAMPLES / 100.0
SMALL, LARGE = 50, 100  # grid points for each of three parameters
GRID_RUNS = 3
SPREAD = 1.5  # the grid spans the true values times and divided by this
STARTS = 60
FACTOR = 2.0  # random starts are off by up to this, each parameter its own
SAME_OPTIMUM = 0.01  # standard deviations
LONGEST_GRID, LONGEST_MILLION, LONGEST_MINIMUM, LONGEST_REFINEMENT = 2.5, 20.0, 3.0, 0.06  # s


def drive() -> list[Segment]:
    """Return the drive as a recording for calibration."""
    return segments_of(recording(SECONDS))


def axes(points: int) -> tuple[Floats, Floats, Floats]:
    """Return the axes of a grid with `points` points for each of the three parameters."""
    factors = np.geomspace(1.0 / SPREAD, SPREAD, points)
    first, second, third = (getattr(TRUTH, name) * factors for name in NAMES)
    return first, second, third


def grid() -> Iterator[Row]:
    """Measure the grid search over the whole path, and the search that abandons candidates early."""
    segments = drive()
    small = [_timed(lambda: search(segments, TRUTH.wheel_radius, axes(SMALL)))[0] for _ in range(GRID_RUNS)]
    yield _grid_row("whole surface", SMALL, small, LONGEST_GRID)
    time_of_whole, whole = _timed(lambda: search(segments, TRUTH.wheel_radius, axes(LARGE)))
    yield _grid_row("whole surface", LARGE, [time_of_whole], LONGEST_MILLION)
    early = [_timed(lambda: minimum(segments, TRUTH.wheel_radius, axes(LARGE))) for _ in range(GRID_RUNS)]
    for _, best in early:
        assert best == whole.best, f"early abandoning found {best}, the whole surface {whole.best}"
    title = "the minimum alone, by early abandoning, the same as of the whole surface"
    yield _grid_row(title, LARGE, [duration for duration, _ in early], LONGEST_MINIMUM)


def _grid_row(title: str, points: int, times: list[float], goal: float) -> Row:
    timing = Timing(statistics.median(times), min(times))
    return Row(
        f"grid of {points} x {points} x {points} over {SAMPLES:,} samples: {title}",
        seconds(timing),
        f"{timing.median / points**3 / SAMPLES * 1e9:.2g} ns per candidate and sample",
        f"{goal:g} s",
        timing.median <= goal,
    )


def refinement() -> Iterator[Row]:
    """Measure the refinement from random starts within a factor of two of the true parameters."""
    segments = drive()
    optimum = _refine(segments, TRUTH.values)
    random = np.random.default_rng(0)
    times, reached = [], 0
    for _ in range(STARTS):
        factors = FACTOR ** random.uniform(-1.0, 1.0, len(NAMES))
        start = TRUTH.values | {n: getattr(TRUTH, n) * f for n, f in zip(NAMES, factors, strict=True)}
        duration, found = _timed(partial(_refine, segments, start))
        times.append(duration)
        reached += _same(found, optimum)
    timing = Timing(statistics.median(times), min(times))
    yield Row(
        f"refinement on {SAMPLES:,} samples from {STARTS} random starts within a factor of {FACTOR:g}",
        f"{seconds(timing)}; the slowest {max(times):.3g} s",
        f"{reached} of {STARTS} reach the optimum",
        f"all, {LONGEST_REFINEMENT * 1e3:g} ms",
        reached == STARTS and timing.median <= LONGEST_REFINEMENT,
    )


def _timed(work: Callable[[], T]) -> tuple[float, T]:
    """Return the CPU seconds of a function called once, and its result."""
    before = time.process_time()
    result = work()
    return time.process_time() - before, result


def _refine(segments: list[Segment], start: Mapping[str, float]) -> Refined:
    return Refinement(segments, NAMES, start).solve(far=True)


def _same(found: Refined, optimum: Refined) -> bool:
    """Return whether a refinement reached the optimum, which is found when starting from the true parameters."""
    pairs = [(found.estimates[name], optimum.estimates[name]) for name in NAMES]
    return all(abs(estimate.value - best.value) <= SAME_OPTIMUM * best.std for estimate, best in pairs)
