"""Process noise: virtual robots deviate from their model by as much as the diagnosed robot did.

Each wheel is driven with its duty times 1 + d, where d is a normal random process with correlation time FADING (an
Ornstein-Uhlenbeck process, independent for each wheel). So a robot at rest stays at rest, and a driving robot deviates
along its path and in heading.

The size of d comes from the robot's parameter file, where cmr-diagnose writes by how much free runs of 3 s deviated
from the real robot on held-out data. The size is chosen so that free runs of 3 s of the simulated robot deviate by the
same distance, in arcs at about half of full duty. Poses have errors too, so the true noise is at most as large.
"""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cmr.model.motion import RobotState
from cmr.model.parameters import RobotParameters
from cmr.parameters.file import ParameterFile, ParameterFileError
from cmr.world.view import VIRTUAL, Robots

Floats = NDArray[np.float64]
FADING = 0.3  # s; correlation time
STEP = 0.01  # s, of the simulation
KEPT = math.exp(-STEP / FADING)
WINDOW = 3.0  # s, of the diagnosis's free runs
ARC = (0.4, 0.5)  # duties left, right
SETTLING = 1.0  # s before a window, for the motors to reach their speeds
SMALL = 0.01  # share of the duty; up to four times this, deviations are proportional
ROBOTS = 1000  # enough to estimate the deviation to 2 %
STRAYED = "held_out_path_rmse_m"
LARGEST = 0.3  # share of the duty; a robot that deviates by more is not described by its model
CHUNK = 512  # random numbers drawn at once for a wheel


class ProcessNoise:
    """Disturbs the duties of virtual robots; each has its own random numbers, determined by `seed` and its id."""

    def __init__(self, seed: int = 0) -> None:
        self._seed = seed
        self._sizes: dict[int, float] = {}  # share of the duty, by the robot whose parameters are used
        self._problems: dict[int, str] = {}
        self._row_of: dict[int, int] = {}
        self._random: list[np.random.Generator] = []
        self._draws: Floats = np.zeros((0, CHUNK, 2))
        self._next = np.zeros(0, np.int64)
        self._deviation: Floats = np.zeros((0, 2))
        self._robots: tuple[int, ...] | None = None
        self._index = self._rows = np.zeros(0, np.int64)
        self._size: Floats = np.zeros((0, 1))

    def use(self, robot_id: int, file: ParameterFile) -> None:
        """Read the deviation of robots with these parameters from a robot's parameter file."""
        try:
            self._sizes[robot_id] = size_of(file)
            self._problems.pop(robot_id, None)
        except ParameterFileError as error:
            self._sizes[robot_id] = 0.0
            self._problems[robot_id] = f"Virtual robots by the parameters of robot {robot_id} have no noise: {error}"
        self._robots = None

    @property
    def problem(self) -> str:
        """Why some robots have no noise; empty if all have it."""
        return " ".join(problem for _, problem in sorted(self._problems.items()))

    def disturbed(self, duties: Floats, robots: Robots, goes_by: Callable[[int], int]) -> Floats:
        """Return the duties (n, 2) of `robots` for the next step; `goes_by` maps each robot to the robot whose
        parameters it uses.
        """
        if robots.robot_id is not self._robots:
            self._begin(robots, goes_by)
        rows = self._rows
        for row in rows[self._next[rows] == CHUNK]:
            self._draws[row] = self._random[row].standard_normal((CHUNK, 2))
            self._next[row] = 0
        fresh = self._draws[rows, self._next[rows]]
        self._next[rows] += 1
        self._deviation[rows] = _a_step_on(self._deviation[rows], fresh)
        result = np.array(duties, dtype=float)
        result[self._index] *= 1.0 + self._size * self._deviation[rows]
        return result

    def _begin(self, robots: Robots, goes_by: Callable[[int], int]) -> None:
        """Determine which robots get noise, and its size."""
        origin = np.array(robots.origin)
        self._index = np.flatnonzero(origin == VIRTUAL)
        ids = [robots.robot_id[index] for index in self._index]
        self._add([robot_id for robot_id in ids if robot_id not in self._row_of])
        self._rows = np.array([self._row_of[robot_id] for robot_id in ids], np.int64)
        self._size = np.array([[self._sizes.get(goes_by(robot_id), 0.0)] for robot_id in ids]).reshape(-1, 1)
        self._robots = robots.robot_id

    def _add(self, robot_ids: list[int]) -> None:
        """Add robots; each refills its random numbers at a different step, to spread the cost."""
        random = [np.random.default_rng([self._seed, robot_id]) for robot_id in robot_ids]
        self._row_of.update(zip(robot_ids, range(len(self._random), len(self._random) + len(random)), strict=True))
        self._random += random
        first = np.array([one.standard_normal(2) for one in random]).reshape(-1, 2)
        draws = np.array([one.standard_normal((CHUNK, 2)) for one in random]).reshape(-1, CHUNK, 2)
        self._deviation = np.concatenate([self._deviation, first])
        self._draws = np.concatenate([self._draws, draws])
        self._next = np.concatenate([self._next, np.array(robot_ids, np.int64) % CHUNK])


def _a_step_on(deviation: Floats, fresh: Floats) -> Floats:
    """Advance the deviations by one step, given as many new normal numbers; their variance stays 1."""
    return KEPT * deviation + math.sqrt(1.0 - KEPT**2) * fresh


def size_of(file: ParameterFile) -> float:
    """Return the standard deviation of the noise, as a share of the duty, that reproduces the deviation in a robot's
    file.

    Raises ParameterFileError if the file does not contain it, or lacks a parameter of the model.
    """
    distance = file.provenance.get(STRAYED)
    if file.provenance.get("method") != "diagnosis" or not isinstance(distance, (int, float)) or not distance >= 0.0:
        raise ParameterFileError(
            "their file does not say how far free runs deviate. Use one that cmr-diagnose wrote from a log with poses."
        )
    return min(float(distance) / strayed(file.robot_parameters, SMALL) * SMALL, LARGEST)


def strayed(parameters: RobotParameters, size: float) -> float:
    """Return the deviation of robots with this noise from one without, in a window of the arc [m, RMS]."""
    from cmr.model.fleet import Fleet  # imports Numba, which takes half a second

    fleet = Fleet(STEP)
    fleet.add(RobotState.at_rest(np.zeros(ROBOTS + 1)), parameters)
    fleet.command(slice(None), *ARC)
    fleet.advance(round(SETTLING / STEP))
    random = np.random.default_rng(0)
    deviation = random.standard_normal((2, ROBOTS))
    squares = []
    for _ in range(round(WINDOW / STEP)):
        disturbed = np.reshape(ARC, (2, 1)) * (1.0 + size * deviation)
        fleet.command(slice(1, None), *disturbed)
        fleet.advance()
        states = fleet.states()
        squares.append((states.x[1:] - states.x[0]) ** 2 + (states.y[1:] - states.y[0]) ** 2)
        deviation = _a_step_on(deviation, random.standard_normal((2, ROBOTS)))
    return float(np.sqrt(np.mean(squares)))
