"""Residuals of one segment, and their derivatives by all unknowns of the fit.

The unknowns are either shared by all segments or belong to one segment; `Unknowns` assigns columns to them.
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
OWN = ("x", "y", "theta", "marker", "wheel left", "wheel right", "psi left", "psi right")
# Steps of the central differences: of a parameter's logarithm, of a wheel speed at the start; errors of the derivative
# stay near 1e-10.
RELATIVE_STEP, PSI_STEP = 1e-5, 1e-4  # 1; rad/s


@dataclass(frozen=True)
class Unknowns:
    """The columns of a fit: `shared` unknowns, of which the first `parameters` are the model's, then OWN ones.

    Shared: logarithms of model parameters; the delays [s] of commands and of pose stamps; the logarithm of the factor
    between measured and modelled wheel angles. Own: shift (m, m) and rotation (rad) of the start pose, angle of the
    marker on the robot (rad), initial angles of the encoders (rad), and corrections to the measured wheel speeds at the
    start (rad/s).
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


@dataclass(frozen=True)
class Candidates:
    """The current point and its neighbours, a step up and a step down in each unknown of the model.

    `factors` (1 + 2 k, parameters) multiply the parameters, `psi` (1 + 2 k, 2) is added to the wheel speeds at the
    start; k counts the parameters, and both speeds where `with_psi`.
    """

    factors: Floats
    psi: Floats

    @classmethod
    def around(cls, parameters: int, with_psi: bool) -> "Candidates":
        """Return the neighbours for so many parameters."""
        count = parameters + (2 if with_psi else 0)
        steps = np.zeros((1 + 2 * count, count))
        for index in range(count):
            size = RELATIVE_STEP if index < parameters else PSI_STEP
            steps[1 + 2 * index, index], steps[2 + 2 * index, index] = size, -size
        psi = steps[:, parameters:] if with_psi else np.zeros((1 + 2 * count, 2))
        return cls(np.exp(steps[:, :parameters]), psi)


@dataclass(frozen=True)
class Linear:
    """One segment's residuals and derivatives about a path simulated for `Candidates`.

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
        segment, at = self.segment, self.segment.at
        shift_x, shift_y, rotation = self.own[:3]
        x, y = self.trajectory.x[at] - segment.start.x, self.trajectory.y[at] - segment.start.y
        cos, sin = np.cos(rotation), np.sin(rotation)
        turned_x, turned_y = cos * x - sin * y, sin * x + cos * y
        rate_x, rate_y = self._rate(self.trajectory.x), self._rate(self.trajectory.y)
        result = []
        for axis, turned, derivative, rate, offset in (
            ("x", turned_x, -turned_y[:, 0], cos * rate_x - sin * rate_y, segment.start.x + shift_x - segment.x),
            ("y", turned_y, turned_x[:, 0], sin * rate_x + cos * rate_y, segment.start.y + shift_y - segment.y),
        ):
            own = {axis: 1.0, "theta": derivative} if segment.fits_start else {}
            result.append(("position", self._at_poses(turned, offset, rate, own)))
        return result

    def _headings(self) -> tuple[str, Series]:
        """Return the series of headings [rad]; markers need not point forward."""
        segment = self.segment
        offset = self.own[OWN.index("theta")] + self.own[OWN.index("marker")] - segment.theta
        own = {"marker": 1.0} | ({"theta": 1.0} if segment.fits_start else {})
        rate = self._rate(self.trajectory.theta)
        return "heading", self._at_poses(self.trajectory.theta[segment.at], offset, rate, own)

    def _wheels(self) -> list[tuple[str, Series]]:
        """Return the series of each side's wheel angle [rad]; empty if the wheels are the input."""
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
            known = {name: 1.0, COMMAND_TIME: -factor * psi[at, 0], WHEEL_FACTOR: angle[:, 0]}
            offset = self.own[OWN.index(name)] - measured
            result.append(("wheel angle", self._series(angle, offset, segment.border_times[at], known)))
        return result

    def _at_poses(self, modelled: Floats, offset: Floats, rate: Floats, own: Mapping[str, Floats | float]) -> Series:
        known = {COMMAND_TIME: -rate, POSE_TIME: -rate} | dict(own)
        return self._series(modelled, offset, self.segment.border_times[self.segment.at], known)

    def _rate(self, values: Floats) -> Floats:
        """Return the time derivative, at the poses, of a quantity given at the borders.

        If the path begins at the first measured pose, a late clock shifts that pose as well, so the rate at the start
        is subtracted.
        """
        time, at = self.segment.border_times, self.segment.at
        before, after = np.maximum(at - 1, 0), np.minimum(at + 1, len(time) - 1)
        rate = np.asarray((values[after, 0] - values[before, 0]) / (time[after] - time[before]))
        return rate if self.segment.fits_start else rate - rate[0]

    def _series(self, modelled: Floats, offset: Floats, times: Floats, known: Mapping[str, Floats | float]) -> Series:
        """Return the series of `modelled` (n, candidates) plus `offset` (n,), with its derivatives.

        Those by model parameters are differences of candidates, the others are `known`. Delays enter linearly, through
        the rates.
        """
        stepped, sizes = self._stepped
        derivatives = {name: values for name, values in known.items() if self.unknowns.column(name) is not None}
        rows = np.empty((1 + len(stepped) + len(derivatives), len(times)))
        np.add(modelled[:, 0], offset, out=rows[0])
        np.subtract(modelled[:, 1::2].T, modelled[:, 2::2].T, out=rows[1 : 1 + len(stepped)])
        rows[1 : 1 + len(stepped)] *= sizes[:, np.newaxis]
        for row, (name, values) in enumerate(derivatives.items(), start=1 + len(stepped)):
            rows[row] = values
            if name in TIMES:
                rows[0] += rows[row] * self.shared[self.unknowns.shared.index(name)]
        columns = [self.unknowns.column(name) for name in derivatives]
        return Series(rows, (*stepped, *(column for column in columns if column is not None)), times)

    @property
    def _stepped(self) -> tuple[list[int], Floats]:
        """The columns of the stepped unknowns, with the factors that turn differences into derivatives."""
        parameters = self.unknowns.parameters
        with_psi = self.trajectory.x.shape[1] > 1 + 2 * parameters
        columns, sizes = list(range(parameters)), [0.5 / RELATIVE_STEP] * parameters
        if with_psi:
            columns += [len(self.unknowns.shared) + OWN.index(name) for name in ("psi left", "psi right")]
            sizes += [0.5 / PSI_STEP] * 2
        return columns, np.array(sizes)
