"""How clearly physics shows to an observer who knows it: the likelihood ratio against the best robot without it.

The robot drives twice without noise, with and without what is hidden; what differs between its signals from sample to
sample is whitened by the noise of noisy drives, and all that other values of the paper's parameters would explain is
taken away. The squares of what is left add up to twice the difference of the log-likelihoods.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cmr.recordings.signal import Floats
from tests.hidden_effects.cases import Truth
from tests.hidden_effects.driving import commands_of
from tests.reference_plant import SILENT, Commands, Noise, drive

VISIBLE = 300.0  # likelihood ratio from which a kind counts as visible
EVERY = 4  # wheel readings for each pose
# Poses from one sample to the next, and samples of the noise's autoregression: what is fast shows in many short steps,
# what depends on the place in long ones.
SPANS = ((1, 25), (12, 8), (50, 4))
STEP = 1e-3  # share by which each of the paper's parameters is changed
FITTED = ("k2_over_k3", "k1", "base_width")


def visibility(truth: Truth) -> float:
    """Return twice the log-likelihood that what is hidden adds, for an observer who knows it: at least that much."""
    without = replace(truth, parameters={}, case=replace(truth.case, effects=()))
    commands = commands_of(truth, truth.case.drive_seed)
    with_it, bare = (_signals(one, commands, SILENT) for one in (truth, without))
    noise = [_signals(without, commands, truth.noise, seed) - bare for seed in range(1, 5)]
    directions = [_changed(without, commands, name) - bare for name in FITTED]
    return max(_ratio([with_it - bare, *directions], noise, *span) for span in SPANS)


def _ratio(differences: Sequence[Floats], noise: Sequence[Floats], every: int, memory: int) -> float:
    """Return the ratio for the first of the differences, beside the others, from samples over `every` poses."""
    left, *others = _whitened(*([_summed(one, every) for one in part] for part in (differences, noise)), memory)
    columns = np.column_stack(others)
    left = left - columns @ np.linalg.lstsq(columns, left, rcond=None)[0]
    return float(left @ left)


def _summed(signals: Floats, every: int) -> Floats:
    """Return the sums of so many samples that follow one another, (6, n / every)."""
    count = signals.shape[1] // every
    return signals[:, : count * every].reshape(len(signals), count, every).sum(axis=2)


def _changed(truth: Truth, commands: Commands, name: str) -> Floats:
    robot = {**truth.robot, name: truth.robot[name] * (1.0 + STEP)}
    return _signals(replace(truth, robot=robot), commands, SILENT)


def _signals(truth: Truth, commands: Commands, noise: Noise, seed: int = 0) -> Floats:
    """Return per sample: what both wheels and the robot's heading turned, gyro, way ahead and sideways; (6, n)."""
    recording = drive(commands, truth.plant, truth.case.seconds, noise, seed).recording
    turned = [np.diff(recording.wheels[f"ticks_{side}"][::EVERY]) for side in ("left", "right")]
    place, theta = recording.poses["x"] + 1j * recording.poses["y"], np.unwrap(recording.poses["theta"])
    middle = 0.5 * (theta[1:] + theta[:-1])
    way = np.diff(place) * np.exp(-1j * middle)
    count = min(len(turned[0]), len(way), len(recording.gyro) // EVERY)
    rate = recording.gyro["yaw_rate"][: EVERY * count].reshape(count, EVERY).mean(axis=1)
    columns = [*turned, np.diff(theta), rate, way.real, way.imag]
    return np.array([column[:count] for column in columns])


def _whitened(signals: Sequence[Floats], noise: Sequence[Floats], memory: int) -> list[Floats]:
    """Return signals, (6, n) each, in units of the innovations of the noise: a vector autoregression fitted to it."""
    scale = np.std(np.concatenate(noise, axis=1), axis=1, keepdims=True)
    signals, noise = [one / scale for one in signals], [one / scale for one in noise]
    past, now = (np.concatenate(parts) for parts in zip(*(_past_and_now(one, memory) for one in noise), strict=True))
    weights = np.linalg.lstsq(past, now, rcond=None)[0]
    innovations = now - past @ weights
    factor = np.linalg.inv(np.linalg.cholesky(innovations.T @ innovations / len(now)))
    return [
        ((now - past @ weights) @ factor.T).ravel() for past, now in (_past_and_now(one, memory) for one in signals)
    ]


def _past_and_now(signals: Floats, memory: int) -> tuple[Floats, Floats]:
    """Return what was before each sample, (n - memory, 6 memory), and the samples, (n - memory, 6)."""
    windows = np.lib.stride_tricks.sliding_window_view(signals[:, :-1], memory, axis=1)
    return windows.transpose(1, 0, 2).reshape(windows.shape[1], -1), signals[:, memory:].T
