"""Rows of the step: its time for many robots, compared with a C kernel and the memory bandwidth, and its accuracy."""

from collections.abc import Iterator

import numpy as np

from benchmarks.c_kernel import NoCompilerError, build
from benchmarks.drive import STEP, TRUTH, duties, exact_path
from benchmarks.report import Row, per_robot, skipped
from benchmarks.timing import bandwidth, clocked, in_turns, read_modify_write
from cmr.model import paper
from cmr.model.fleet import Fleet
from cmr.model.motion import RobotState
from cmr.model.parameters import RobotParameters
from cmr.recordings.recording import Floats

ROBOTS = (1_000, 10_000, 100_000, 1_000_000)
LONGEST_STEP = 4e-9  # s per robot
LARGEST_RATIO = 1.6  # to the C kernel
SMALLEST_SHARE = 0.6  # of the memory bandwidth
LARGEST_ERROR = 1e-7  # m
# Bytes that a step moves per robot: five numbers of state are read and written, two duties and the coefficients read.
BYTES = 8 * (2 * 5 + 2 + paper.COEFFICIENTS)
SAME = 1e-9  # m, rad or rad/s; the steps of CMR and the C kernel agree within rounding
DRIVE_SECONDS, DRIVE_DUTY = 60.0, 1.0 / 1.2  # the fastest figure-eight: its outer wheel at full duty


def robots(count: int) -> tuple[RobotState, RobotParameters, Floats]:
    """Return random states, parameters and duties (2, count), different for each robot."""
    random = np.random.default_rng(0)
    pose = random.uniform(-3.0, 3.0, (3, count))
    state = RobotState(*pose, *random.uniform(-15.0, 15.0, (2, count)), *np.zeros((2, count)))
    spread = random.uniform(0.8, 1.2, (4, count))
    parameters = RobotParameters(*(value * factor for value, factor in zip(TRUTH, spread, strict=True)))
    return state, parameters, random.uniform(-0.8, 0.8, (2, count))


def fleet_of(state: RobotState, parameters: RobotParameters, duty: Floats) -> Fleet:
    """Return these robots as a fleet that moves in steps of 10 ms."""
    fleet = Fleet(STEP * 1e-6)
    fleet.command(fleet.add(state, parameters), *duty)
    return fleet


def rows_of_the_kernel(state: RobotState, parameters: RobotParameters, duty: Floats) -> list[Floats]:
    """Return the arrays for the bare kernel: state, duties and coefficients of each robot."""
    coefficients = np.empty((paper.COEFFICIENTS, duty.shape[1]))
    paper.fill_coefficients(np.array([*parameters]), STEP * 1e-6, coefficients)
    return [np.array(row) for row in (*state[:5], *duty, *coefficients)]


def step() -> Iterator[Row]:
    """Measure the step of N robots, alternating with the C kernel and a measurement of the memory bandwidth."""
    try:
        bind = build()
    except NoCompilerError as error:
        yield skipped("the C kernel", str(error))
        bind = None
    for count in ROBOTS:
        robot = robots(count)
        fleet = fleet_of(*robot)
        works = {"ours": clocked(fleet.advance), "memory": read_modify_write()}
        if bind:
            arrays = rows_of_the_kernel(*robot)
            c_step = bind(arrays)
            c_step()
            _require_same(fleet_of(*robot), arrays)
            works["C"] = clocked(c_step)
        timings = in_turns(works)
        ours = timings["ours"]
        ratio = ours.median / timings["C"].median if bind else 0.0
        yield Row(
            f"step of {count:,} robots, the paper's model",
            per_robot(ours, count),
            f"{ratio:.2f} to C at {per_robot(timings['C'], count)}" if bind else "-",
            f"{LONGEST_STEP * 1e9:g} ns, {LARGEST_RATIO:g} to C",
            ours.median / count <= LONGEST_STEP and ratio <= LARGEST_RATIO,
        )
    rate, available = BYTES * ROBOTS[-1] / ours.median, bandwidth(timings["memory"])
    yield Row(
        f"memory moved by the step of {ROBOTS[-1]:,} robots, {BYTES} bytes each",
        f"{rate / 1e9:.1f} GB/s",
        f"{rate / available:.0%} of {available / 1e9:.1f} GB/s in place",
        f"{SMALLEST_SHARE:.0%}",
        rate / available >= SMALLEST_SHARE,
    )


def _require_same(fleet: Fleet, arrays: list[Floats]) -> None:
    """Step the fleet once as well; raise AssertionError if it disagrees with the C kernel."""
    fleet.advance()
    states = fleet.states()
    for ours, reference in zip((*states[:2], *states[3:5]), (*arrays[:2], *arrays[3:5]), strict=True):
        assert np.allclose(ours, reference, rtol=0.0, atol=SAME), "the C kernel and the step disagree"
    difference = np.remainder(states.theta - arrays[2] + np.pi, 2.0 * np.pi) - np.pi
    assert np.allclose(difference, 0.0, rtol=0.0, atol=SAME), "the C kernel and the step disagree in heading"


def accuracy() -> Iterator[Row]:
    """Compare a drive in steps of 10 ms with its exact path."""
    left, right = duties(DRIVE_SECONDS, DRIVE_DUTY)
    exact = exact_path(left, right, TRUTH)
    fleet = Fleet(STEP * 1e-6)
    robot = fleet.add(RobotState.at_rest(), TRUTH)
    worst = 0.0
    for k in range(len(left)):
        fleet.command(robot, left[k], right[k])
        fleet.advance()
        state = fleet.states(robot)
        worst = max(worst, float(np.hypot(state.x - exact[0, k + 1], state.y - exact[1, k + 1])[0]))
    length = float(np.sum(np.hypot(np.diff(exact[0]), np.diff(exact[1]))))
    yield Row(
        f"accuracy of 10 ms steps over {DRIVE_SECONDS:.0f} s and {length:.0f} m, largest position error",
        f"{worst:.1e} m",
        goal=f"{LARGEST_ERROR:.0e} m",
        reached=worst <= LARGEST_ERROR,
    )
