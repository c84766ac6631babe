"""Rows of the catalogue of effects: the cost of the step with all effects neutral, and with all effects on."""

from collections.abc import Iterator
from functools import partial

import numpy as np

from benchmarks.report import Row, per_robot
from benchmarks.stepping import ROBOTS, fleet_of, robots, rows_of_the_kernel
from benchmarks.timing import clocked, in_turns
from cmr.model import paper
from cmr.model.catalogue import CATALOGUE, typical, with_effects

LARGEST_RATIO = 1.2  # of the neutral catalogue to the bare kernel
LONGEST_STEP = 60e-9  # s per robot
OF_MOTION = [effect for effect in CATALOGUE.values() if not effect.is_sensor]


def effects() -> Iterator[Row]:
    """Measure the step with all effects neutral, and with all of them on, alternating with the bare kernel."""
    neutral = {parameter.name: parameter.neutral for effect in OF_MOTION for parameter in effect.parameters}
    everything = {name: value for effect in OF_MOTION for name, value in typical(effect).items()}
    for count in ROBOTS:
        state, parameters, duty = robots(count)
        arrays = rows_of_the_kernel(state, parameters, duty)
        without = fleet_of(state, with_effects(parameters, neutral), duty)
        with_all = fleet_of(state, with_effects(parameters, everything), duty)
        works = {
            "kernel": clocked(partial(paper.advance, *arrays)),
            "neutral": clocked(without.advance),
            "all on": clocked(with_all.advance),
        }
        timings = in_turns(works)
        assert not np.allclose(without.states().psi_left, with_all.states().psi_left), "the effects have no effect"
        kernel, neutral_step, all_on = timings["kernel"], timings["neutral"], timings["all on"]
        ratio = neutral_step.median / kernel.median
        yield Row(
            f"step of {count:,} robots, the catalogue of effects present and neutral",
            per_robot(neutral_step, count),
            f"{ratio:.2f} to the kernel without a catalogue at {per_robot(kernel, count)}",
            f"{LARGEST_RATIO:g}",
            ratio <= LARGEST_RATIO,
        )
        yield Row(
            f"step of {count:,} robots, all {len(OF_MOTION)} effects on the motion on",
            per_robot(all_on, count),
            f"{all_on.median / kernel.median:.1f} to the kernel without a catalogue",
            f"{LONGEST_STEP * 1e9:g} ns",
            all_on.median / count <= LONGEST_STEP,
        )
