"""Candidates that are observed together share one time grid, so that differences between them are theirs alone."""

import numpy as np
import pytest

from cmr.model.commands import Commands
from cmr.model.extended.compose import LANES
from cmr.model.observer.commanding import split_steps
from cmr.model.observer.observer import Gains, Observations, observe
from cmr.model.parameters import Quantity
from tests.support.silent_drive import silent_drive

ROBOT = {"wheel_radius": 0.04, "k2_over_k3": 118.0, "k1": 0.054, "base_width": 0.16}
STEPS, STEP = 750, 0.02


def reversing() -> Observations:
    """Return a drive that often reverses, by commands between the borders of steps."""
    time = np.asarray(np.arange(2 * STEPS) * 0.5 * STEP, np.float64)
    duty = 0.02 * np.floor(40.0 * np.sin(2.0 * time))
    return silent_drive(Commands(time + 0.004, np.stack([duty, -duty], axis=1)), STEP, STEPS)


def test_equal_candidates_read_the_same_whoever_stands_beside_them() -> None:
    delays = np.zeros(2 * LANES)
    delays[0] = 0.0075  # a candidate of the first block, whose commands come in other steps
    values: dict[str, Quantity] = {**ROBOT, "coulomb_friction": 3.0, "command_delay": delays}
    for error in observe(reversing(), values, Gains(0.2, 1.0, 0.15, 0.15))[:3]:
        assert np.array_equal(error[..., 1:], np.broadcast_to(error[..., -1:], error[..., 1:].shape))


@pytest.mark.parametrize(("dt", "change", "is_split"), [(0.01, 0.019, 0), (0.01, 0.021, 1), (0.02, 0.019, 1)])
def test_a_step_is_split_for_changes_that_matter_within_it(dt: float, change: float, is_split: int) -> None:
    """A mean command costs up to k2_over_k3 D dt^2 / 8 of angle, which is the same for any step at the limit."""
    profile = np.array([[[0.4, 0.0, 0.0, change, 0.0], [0.0, change, 0.0, change, 0.0]]])
    without = np.zeros_like(profile)
    assert split_steps(np.concatenate([without, profile]), dt).tolist() == [is_split, 0]
