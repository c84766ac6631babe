"""The paper's grid search: every candidate drives the whole path; the nearest to the real path wins."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from cmr.calibration.result import CalibrationError
from cmr.calibration.segments import Segment, travelled, turned_angle
from cmr.model.parameters import RobotParameters
from cmr.recordings.recording import Floats

# Motors of wheeled robots answer with time constants from that of a toy to that of a loaded tractor.
TIME_CONSTANTS = (0.02, 1.0)  # s
POINTS = (13, 21, 21)  # of k2_over_k3, k1, base_width
K1_SPREAD = 1.5  # the grid spans the rough value of k1, found from distance over command, times and over this
BASE_WIDTH_SPREAD = 1.7  # the same for base_width, found from turn over command


@dataclass(frozen=True)
class Grid:
    """A full grid over the three parameters and its error surface.

    `mean_square` [m^2] has shape (len(k2_over_k3), len(k1), len(base_width)): the mean squared distance between the
    real and the simulated position over all time steps.
    """

    k2_over_k3: Floats
    k1: Floats
    base_width: Floats
    mean_square: Floats

    @property
    def best(self) -> dict[str, float]:
        """The grid point with the smallest error."""
        i, j, k = np.unravel_index(int(np.argmin(self.mean_square)), self.mean_square.shape)
        return {
            "k2_over_k3": float(self.k2_over_k3[i]),
            "k1": float(self.k1[j]),
            "base_width": float(self.base_width[k]),
        }


def search(segments: list[Segment], wheel_radius: float, axes: tuple[Floats, Floats, Floats]) -> Grid:
    """Integrate every grid point over the whole path; `axes` are the values of the three parameters."""
    k2_over_k3, k1, base_width = axes
    total = np.zeros((len(k2_over_k3), len(k1), len(base_width)))
    for i, gain in enumerate(k2_over_k3):  # one slice at a time: the whole grid at once would not fit the memory
        candidates = RobotParameters(wheel_radius, gain, k1[:, np.newaxis], base_width[np.newaxis, :])
        for segment in segments:
            path = segment.simulate(candidates)
            real_x, real_y = segment.x[:, np.newaxis, np.newaxis], segment.y[:, np.newaxis, np.newaxis]
            total[i] += np.sum((path.x[segment.at] - real_x) ** 2 + (path.y[segment.at] - real_y) ** 2, axis=0)
    return Grid(k2_over_k3, k1, base_width, total / sum(len(segment.x) for segment in segments))


def axes_for(segments: list[Segment], wheel_radius: float, base_width: float | None) -> tuple[Any, Any, Any]:
    """Choose the grid's axes from the data alone, so that a wrong nominal value cannot mislead the search.

    `base_width` fixes that axis where the robot did not turn. Raises CalibrationError when commands and motion
    do not go together.
    """
    commanded, distance, difference, angle = 0.0, 0.0, 0.0, 0.0
    for segment in segments:
        commanded += float(np.sum(np.abs(segment.left + segment.right) / 2.0 * segment.dt))
        difference += float(np.sum(np.abs(segment.right - segment.left) * segment.dt))
        distance += travelled(segment.x, segment.y)
        angle += turned_angle(segment.theta)
    if distance == 0.0 or commanded == 0.0:
        raise CalibrationError("The robot did not travel while it was commanded: nothing to compare.")
    k1 = wheel_radius * commanded / distance
    k1_axis = k1 * np.geomspace(1.0 / K1_SPREAD, K1_SPREAD, POINTS[1])
    gain_axis = 1.0 / (k1 * np.geomspace(TIME_CONSTANTS[1], TIME_CONSTANTS[0], POINTS[0]))
    if base_width is not None or angle == 0.0:
        return gain_axis, k1_axis, np.array([base_width or 1.0])
    rough = wheel_radius / k1 * difference / angle
    return gain_axis, k1_axis, rough * np.geomspace(1.0 / BASE_WIDTH_SPREAD, BASE_WIDTH_SPREAD, POINTS[2])
