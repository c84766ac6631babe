"""Laws move robots as the effects do that say the same, and as their closed forms say."""

from collections.abc import Iterator

import numpy as np
import pytest

from cmr.model.catalogue import learn, unlearn
from cmr.model.laws.law import Law
from cmr.model.motion import RobotState, Trajectory, drive
from cmr.model.parameters import RobotParameters

pytestmark = pytest.mark.slow  # compiles the model with these laws

PAPER = {"wheel_radius": 0.04, "k2_over_k3": 60.0, "k1": 0.04, "base_width": 0.2}
# Each law, its parameters' values, and those of the effect of the catalogue that says the same.
SAME = (
    (Law("law_skid", "lateral_speed", ("v * w",)), {"law_skid": -0.06}, {"lateral_skid": 0.06}),
    (Law("law_drag", "wheel_acceleration", ("psi * abs(psi)",), "both"), {"law_drag": -0.06}, {"quadratic_drag": 0.06}),
    (
        Law("law_gain", "wheel_voltage", ("u",), "opposite"),
        {"law_gain": 0.03},
        {"motor_gain_asymmetry": 0.03},
    ),
    (
        Law("law_empty", "wheel_voltage", ("u * charge / 10.0",), "both"),
        {"law_empty": -0.3},
        {"battery_drift": 0.3},
    ),
    (Law("law_lag", "wheel_slip", ("domega",), "both"), {"law_lag": -0.02}, {"longitudinal_slip": 0.02}),
    (
        Law("law_travel", "forward_speed", ("v * abs(w)",)),
        {"law_travel": -0.05},
        {"travel_reduction_share": 0.05},
    ),
)
STEPS, DT = 1500, 0.01
BEGIN, SLOW = 7.0, 2.0  # s
CLOSED = (
    Law("law_begins", "yaw_rate", ("step(t, begin)",), constants={"begin": BEGIN}),
    Law("law_follows", "lateral_speed", ("low_pass(v, tau)",), constants={"tau": SLOW}),
    Law("law_counts", "encoder_rate", ("psi",), "left"),
    Law("law_disc", "yaw_rate", ("disc(0.5, 0.0, 0.2)",)),
)


@pytest.fixture(autouse=True, scope="module")
def _laws() -> Iterator[None]:
    laws = [*(law for law, _, _ in SAME), *CLOSED]
    for law in laws:
        learn(law)
    yield
    for law in laws:
        unlearn(law.name)


def driven(effects: dict[str, float], left: np.ndarray, right: np.ndarray) -> Trajectory:
    """Return a drive of a robot with these effects; all laws are in the model, so that it is compiled once."""
    others = {law.name: 0.0 for law in (*(law for law, _, _ in SAME), *CLOSED)}
    parameters = RobotParameters.of({**PAPER, **others, **effects})
    return drive(left, right, np.full(len(left), DT), parameters, RobotState.at_rest())


@pytest.mark.parametrize(("law", "values", "effect"), SAME, ids=lambda one: getattr(one, "name", ""))
def test_a_law_moves_a_robot_as_the_effect_does_that_says_the_same(
    law: Law, values: dict[str, float], effect: dict[str, float]
) -> None:
    duties = np.random.default_rng(3).uniform(-0.6, 0.6, (2, STEPS // 50)).repeat(50, axis=1)

    by_law, by_effect, without = (driven(one, *duties) for one in (values, effect, {}))

    for name in ("x", "y", "theta", "psi_left", "angle_right"):
        size = np.abs(getattr(by_effect, name) - getattr(without, name)).max()
        # What a law calls speeds is what the wheels say, before other effects: no more than rounding here.
        assert np.abs(getattr(by_law, name) - getattr(by_effect, name)).max() < 1e-9 + 1e-6 * size, law.name
    assert np.abs(by_effect.x - without.x).max() > 1e-3


def test_laws_of_time_memory_encoders_and_places_have_their_closed_forms() -> None:
    straight = np.full(STEPS, 0.1)
    time = np.arange(STEPS + 1) * DT

    without = driven({}, straight, straight)
    speed = 0.04 * without.psi_left
    turned = driven({"law_begins": 0.1}, straight, straight)
    aside = driven({"law_follows": 0.1}, straight, straight)
    counted = driven({"law_counts": 0.01}, straight, straight)
    inside = driven({"law_disc": 1e-3}, straight, straight)  # so that the way through is straight

    assert np.allclose(turned.theta, 0.1 * np.maximum(time - BEGIN, 0.0), atol=1e-9)
    # A filter of first order behind a speed that itself comes to its end by the motor's rate.
    rate = PAPER["k2_over_k3"] * PAPER["k1"]
    final, slow = 0.1 / PAPER["k1"] * 0.04, 1.0 / SLOW
    smooth = final * (1.0 - (rate * np.exp(-slow * time) - slow * np.exp(-rate * time)) / (rate - slow))
    moved = np.concatenate([[0.0], np.cumsum(0.5 * (smooth[1:] + smooth[:-1])) * DT])
    assert np.abs(aside.y - 0.1 * moved).max() < 0.1 * final * DT * 1.01  # memory is that of the step before
    assert np.allclose(counted.angle_left, 1.01 * without.angle_left, rtol=1e-9)
    assert np.allclose(counted.x, without.x, atol=1e-12)
    through = 0.4 / speed[np.argmax(without.x > 0.5)]  # s that the disc of 0.2 m takes to be crossed
    assert abs(inside.theta[-1] - 1e-3 * through) < 1e-3 * 0.5 * DT
