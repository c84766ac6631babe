"""Residuals of one segment, and how they change with every unknown of the fit.

The unknowns are either shared by all segments or the segment's own; `Unknowns` says which there are and in which
column each stands.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cmr.calibration.noise import Series
from cmr.calibration.segments import Segment
from cmr.model.motion import Trajectory
from cmr.recordings.recording import Floats

COMMAND_TIME, POSE_TIME, WHEEL_FACTOR = "command time", "pose time", "wheel factor"
TIMES = (COMMAND_TIME, POSE_TIME)
OWN = ("x", "y", "theta", "marker", "wheel left", "wheel right")
RELATIVE_STEP = 1e-5  # of the central differences; errors of the derivative stay near 1e-10


@dataclass(frozen=True)
class Unknowns:
    """The columns of a fit: `shared` unknowns, the first `parameters` of which are the model's; then OWN ones.

    Shared: logarithms of model parameters; the times [s] by which commands take effect, and poses are stamped, later
    than they say; the logarithm of the factor between measured and modelled wheel angles. Own: shift (m, m) and
    rotation (rad) of the start pose, angle of the marker on the robot (rad), angles (rad) at which the encoders began.
    """

    shared: tuple[str, ...]
    parameters: int

    @property
    def count(self) -> int:
        """How many columns there are."""
        return len(self.shared) + len(OWN)

    def column(self, name: str) -> int | None:
        """Return the column of an unknown; None where it is not fitted."""
        if name in OWN:
            return len(self.shared) + OWN.index(name)
        return self.shared.index(name) if name in self.shared else None


def factors(parameters: int) -> Floats:
    """Return the factors (1 + 2 parameters, parameters) of the candidates for `Linear`: none, then a step up and down
    for each parameter in turn.
    """
    steps = np.zeros((1 + 2 * parameters, parameters))
    for index in range(parameters):
        steps[1 + 2 * index, index], steps[2 + 2 * index, index] = RELATIVE_STEP, -RELATIVE_STEP
    return np.exp(steps)


@dataclass(frozen=True)
class Linear:
    """One segment's residuals and derivatives about a path simulated for the candidates of `factors`.

    `shared` and `own` are the present values of the unknowns.
    """

    unknowns: Unknowns
    segment: Segment
    trajectory: Trajectory
    shared: Floats
    own: Floats

    def series(self) -> list[tuple[str, Series]]:
        """Return all series of the segment with the names of their signals."""
        return [*self._positions(), self._headings(), *self._wheels()]

    def _positions(self) -> list[tuple[str, Series]]:
        """Return the series of both coordinates [m], the path placed by the segment's shift and rotation."""
        segment, path = self.segment, self.trajectory
        shift = self.own[:3]
        x, y = path.x - segment.start.x, path.y - segment.start.y
        cos, sin = np.cos(shift[2]), np.sin(shift[2])
        turned_x, turned_y = cos * x - sin * y, sin * x + cos * y
        result = []
        for axis, turned, derivative, start, measured in (
            ("x", turned_x, -turned_y, segment.start.x + shift[0], segment.x),
            ("y", turned_y, turned_x, segment.start.y + shift[1], segment.y),
        ):
            own = {axis: 1.0, "theta": derivative[segment.at, 0]} if segment.fits_start else {}
            residual = start + turned[segment.at] - measured[:, np.newaxis]
            result.append(("position", self._at_poses(residual, self._rate(turned[:, 0]), own)))
        return result

    def _headings(self) -> tuple[str, Series]:
        """Return the series of headings [rad]; markers need not point forward."""
        segment = self.segment
        shift = self.own[OWN.index("theta")] + self.own[OWN.index("marker")]
        residual = self.trajectory.theta[segment.at] + shift - segment.theta[:, np.newaxis]
        own = {"marker": 1.0} | ({"theta": 1.0} if segment.fits_start else {})
        return "heading", self._at_poses(residual, self._rate(self.trajectory.theta[:, 0]), own)

    def _wheels(self) -> list[tuple[str, Series]]:
        """Return the series of each side's wheel angle [rad]; none where the wheels are followed."""
        segment, path = self.segment, self.trajectory
        column = self.unknowns.column(WHEEL_FACTOR)
        if column is None:
            return []
        factor = np.exp(self.shared[column])
        result = []
        for name, at, psi, modelled, measured in (
            ("wheel left", segment.left_at, path.psi_left, path.angle_left, segment.left_edge),
            ("wheel right", segment.right_at, path.psi_right, path.angle_right, segment.right_edge),
        ):
            if len(at) < 2:
                continue
            angle = factor * modelled[at]
            residual = angle + self.own[OWN.index(name)] - measured[:, np.newaxis]
            derivatives = {name: 1.0, COMMAND_TIME: -factor * psi[at, 0], WHEEL_FACTOR: angle[:, 0]}
            result.append(("wheel angle", self._series(residual, segment.border_times[at], derivatives)))
        return result

    def _at_poses(self, residual: Floats, rate: Floats, own: Mapping[str, Floats | float]) -> Series:
        late = -rate[self.segment.at]
        return self._series(
            residual, self.segment.border_times[self.segment.at], {COMMAND_TIME: late, POSE_TIME: late} | dict(own)
        )

    def _rate(self, values: Floats) -> Floats:
        """Return the derivative by time of what is known at the borders."""
        return np.asarray(np.gradient(values, self.segment.border_times))

    def _series(self, residual: Floats, times: Floats, known: Mapping[str, Floats | float]) -> Series:
        """Return the first candidate's residuals (n, candidates) with derivatives: by differences, and `known` ones.

        Times enter linearly: what happens later by a little is less by that much of its rate.
        """
        parameters = self.unknowns.parameters
        derivatives = np.zeros((len(residual), self.unknowns.count))
        derivatives[:, :parameters] = (residual[:, 1::2] - residual[:, 2::2]) / (2.0 * RELATIVE_STEP)
        first = residual[:, 0].copy()
        for name, values in known.items():
            column = self.unknowns.column(name)
            if column is not None:
                derivatives[:, column] = values
                if name in TIMES:
                    first += values * self.shared[column]
        return Series(first, derivatives, times)
