"""A wheel that dry friction brings to rest within a step: gyro and encoders read what finer steps say."""

import numpy as np
import pytest

from cmr.model.commands import Commands
from cmr.model.observer import observer as observing
from cmr.model.observer.observer import Gains, Observations, observe
from cmr.model.observer.structures import Innovations

ROBOT = {"wheel_radius": 0.04, "k2_over_k3": 118.0, "k1": 0.054, "base_width": 0.16}
FREE = Gains(0.0, 0.0, 0.0, 0.0)
STEPS, STEP, FINER = 1000, 0.01, 8
BACK = 120  # steps that the observer looks back
JUMP = 2.0 * 0.4 * ROBOT["k2_over_k3"] * ROBOT["wheel_radius"] / ROBOT["base_width"]  # rad/s^2 of one wheel's duty


def observed(friction: float, finer: int = 1) -> Innovations:
    """Readings, with the opposite sign, of a robot whose wheels reverse again and again, on steps so much finer."""
    sent = np.asarray(np.arange(70) * 0.15, np.float64)
    duty = 0.4 * np.stack([np.sign(np.sin(3.0 * sent + 0.1)), np.sign(np.cos(4.0 * sent + 0.2))], axis=1)
    read = np.asarray(np.arange(0.3, STEPS - 1.0, 0.7) * STEP, np.float64)
    read = read[np.min(np.abs(read[:, None] - sent), axis=1) > 0.01 * STEP]  # at a jump either side is right
    borders = np.asarray(np.arange(1, STEPS) * STEP, np.float64)
    what = Observations(
        dt=STEP / finer,
        steps=STEPS * finer,
        commands=Commands(sent, duty),
        start=(0.0, 0.0, 0.0, 0.0, 0.0),
        wheel_time=borders,
        wheel=np.zeros((len(borders), 2)),
        wheel_use=np.ones((len(borders), 2), np.uint8),
        gyro_time=read,
        gyro=np.zeros(len(read)),
        pose_time=borders[::4].copy(),
        pose=np.zeros((len(borders[::4]), 3)),
        pose_use=np.ones(len(borders[::4]), np.uint8),
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(observing, "LONGEST_LATENCY", BACK * what.dt)
        return observe(what, {**ROBOT, "coulomb_friction": friction}, FREE)


@pytest.mark.parametrize("friction", [0.4, 4.0])
def test_readings_of_a_wheel_that_friction_reverses_are_those_of_finer_steps(friction: float) -> None:
    """Friction makes the acceleration jump by twice its size where the wheel stands.

    A straight line through a step is off by up to a quarter of what such a jump changes within it, and the moment of
    standing is known to second order. The speed of before and after alone, without the line, would be off by half of
    what the whole acceleration changes: JUMP.
    """
    coarse, fine = observed(friction), observed(friction, FINER)
    turn = ROBOT["wheel_radius"] / ROBOT["base_width"]
    assert np.max(np.abs(coarse.gyro - fine.gyro)) < 0.5 * friction * turn * STEP + 0.002 * JUMP * STEP
    assert np.max(np.abs(coarse.wheel - fine.wheel)) < 2e-4 * friction


def test_friction_that_is_nearly_none_changes_nearly_nothing() -> None:
    """At 1e-6 rad/s^2 for 10 s, wheels are off by at most 1e-5 rad, and speeds by 1e-6 rad/s times 1 / rate."""
    least, none = observed(1e-6), observed(0.0)
    assert np.max(np.abs(least.gyro - none.gyro)) < 1e-6
    assert np.max(np.abs(least.wheel - none.wheel)) < 1e-5
