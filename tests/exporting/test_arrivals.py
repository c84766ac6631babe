"""Commands take effect in exports when they do for calibration and diagnosis."""

import numpy as np
import pytest

from cmr.exporting.arrivals import in_force, prompt
from cmr.exporting.python_file import SHORTEST
from cmr.model import commands
from cmr.model.parameters import RobotParameters
from tests.exporting.exported_robots import PAPER

STEP, STEPS = 0.01, 200


def robot(**effects: float) -> RobotParameters:
    return RobotParameters(*PAPER, effects=effects)


def sent() -> np.typing.NDArray[np.float64]:
    return np.random.default_rng(5).uniform(-1.0, 1.0, (STEPS, 2))


@pytest.mark.parametrize("delay", [0.0, 0.000009, 0.004, 0.01, 0.0239, 0.05])
def test_commands_that_are_late_split_the_steps_that_the_diagnosis_splits(delay: float) -> None:
    duty = sent()
    spans = in_force(robot(command_delay=delay), duty[:, 0], duty[:, 1], np.full(STEPS, STEP), 0)
    ends = np.concatenate([[0], spans.ends])
    profile = np.nan_to_num(commands.Commands(np.arange(STEPS) * np.float64(STEP), duty).profile(STEP, STEPS, delay))
    for step, (split, *first, left, right) in enumerate(profile.tolist()):
        rows = slice(ends[step], ends[step + 1])
        shares, sides = spans.dt[rows] / STEP, np.stack([spans.left[rows], spans.right[rows]], axis=1)
        assert shares == pytest.approx([split, 1.0 - split] if split else [1.0], abs=1e-9)
        assert sides.tolist() == ([first, [left, right]] if split else [[left, right]])


def test_commands_that_are_late_by_chance_keep_their_order_in_time_and_their_sum_of_durations() -> None:
    dt = np.random.default_rng(6).choice([0.005, 0.01, 0.03], STEPS)
    left, right = sent().T
    spans = in_force(robot(command_jitter=0.04, command_loss=0.2), left, right, dt, 3)
    assert np.all(spans.dt > 0.0)
    np.testing.assert_allclose(np.cumsum(spans.dt)[spans.ends - 1], np.cumsum(dt), rtol=1e-12)


def test_a_robot_that_is_prompt_has_no_late_commands() -> None:
    parameters = robot(command_jitter=0.04, command_delay=0.1, slope_x=0.3)
    assert set(prompt(parameters).effects) == {"slope_x"}
    duty = sent()
    spans = in_force(prompt(parameters), duty[:, 0], duty[:, 1], np.full(STEPS, STEP), 0)
    np.testing.assert_array_equal(np.stack([spans.left, spans.right], axis=1), duty)


def test_what_counts_as_a_border_is_the_same_for_all() -> None:
    assert SHORTEST == commands.SHORTEST
