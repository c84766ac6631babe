"""Rows of laws: the cost of the step with a law, compared with an equivalent effect of the catalogue."""

from collections.abc import Iterator

import numpy as np

from benchmarks.report import Row, per_robot
from benchmarks.stepping import fleet_of, robots
from benchmarks.timing import clocked, in_turns
from cmr.model.catalogue import CATALOGUE, LAWS, learn, typical, unlearn, with_effects
from cmr.model.laws import Law

LARGEST_RATIO = 1.2  # of a model with a law to one with the effect of the same kind
COUNTS = (1_000, 10_000)
# A law of each kind, its coefficients, and the effect with which it is compared.
PAIRS = (
    (Law("law_of_body", "forward_speed", ("v * abs(w)",)), (-0.05,), "travel_reduction"),
    (Law("law_of_wheels", "wheel_acceleration", ("psi * abs(psi)",), "both"), (-0.06,), "quadratic_drag"),
    (
        Law("law_with_memory", "wheel_voltage", ("s * low_pass(u**2, tau)",), "both", {"tau": 60.0}),
        (-0.06,),
        "motor_heating",
    ),
    (
        Law(
            "law_of_a_place",
            "wheel_acceleration",
            ("sign(psi) * disc(px, py, radius)",),
            "both",
            {"px": 1.0, "py": 0.5, "radius": 0.4},
        ),
        (-4.0,),
        "surface_patch",
    ),
    (
        Law("law_of_heading", "wheel_acceleration", ("cos(theta)", "sin(theta)"), "both"),
        (-1.0, -1.0),
        "slope",
    ),
)


def laws() -> Iterator[Row]:
    """Measure the step with each law, alternating with the effect; the model with each law is compiled first."""
    for law, values, effect in PAIRS:
        learn(law)
        by_law = {**dict(zip(law.coefficients, values, strict=True)), **constants(law)}
        for count in COUNTS:
            state, parameters, duty = robots(count)
            with_effect = fleet_of(state, with_effects(parameters, typical(CATALOGUE[effect])), duty)
            with_law = fleet_of(state, with_effects(parameters, by_law), duty)
            without = fleet_of(state, parameters, duty)
            works = {"effect": clocked(with_effect.advance), "law": clocked(with_law.advance)}
            without.advance()
            timings = in_turns(works)
            assert not np.allclose(without.states().x, with_law.states().x), "the law has no effect"
            ratio = timings["law"].median / timings["effect"].median
            yield Row(
                f"step of {count:,} robots with {law.name}: {law.place}, {' and '.join(law.formulas)}",
                per_robot(timings["law"], count),
                f"{ratio:.2f} to the step with {effect} at {per_robot(timings['effect'], count)}",
                f"{LARGEST_RATIO:g}",
                ratio <= LARGEST_RATIO,
            )
        unlearn(law.name)
    assert not LAWS


def constants(law: Law) -> dict[str, float]:
    """Return the constants of a law, by the names of their parameters."""
    return {law.parameter_of(name): value for name, value in law.constants.items()}
