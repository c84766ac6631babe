"""What a calibration found: estimates, what could not be identified and why, and the path error."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from cmr.estimation.estimates import Estimate
from cmr.model.parameters import DEFINITIONS
from cmr.parameters.file import ParameterFile, Value
from cmr.recordings.signal import Floats

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from cmr.calibration.grid import Grid
    from cmr.calibration.segments import Segment


@dataclass(frozen=True, kw_only=True)
class CalibrationResult:
    """What was found of one robot.

    `estimates` holds each identified parameter's value and standard deviation, which is its Cramer-Rao bound for the
    noise found in the data. `covariance` [products of units] is that of `names`, in their order. `unidentified`
    tells, by parameter, why the data do not determine it. `nominal` is what was known before, `samples` how many
    measurements of the path (or of the wheels, without a path) were compared. `path_rmse_before` and
    `path_rmse_after` are the root mean square distances [m] between the real path and the one simulated with the
    nominal and with the found parameters, NaN where there is no path to compare. `notes` are sentences on what else
    was noticed. `segments` are the drives compared, `grid` the error surface of the grid search, None without one;
    `by_wheels` tells that the path follows the measured wheels, not the commands.
    """

    robot_id: int
    estimates: Mapping[str, Estimate]
    unidentified: Mapping[str, str]
    nominal: ParameterFile
    method: str
    samples: int
    covariance: Floats
    path_rmse_before: float = math.nan
    path_rmse_after: float = math.nan
    notes: tuple[str, ...] = ()
    segments: list["Segment"] = field(default_factory=list, repr=False)
    grid: "Grid | None" = field(default=None, repr=False)
    by_wheels: bool = False

    @property
    def names(self) -> tuple[str, ...]:
        """The identified parameters, in the order of `x` and `covariance`."""
        return tuple(self.estimates)

    @property
    def x(self) -> Floats:
        """The estimates, shape (n,)."""
        return np.array([estimate.value for estimate in self.estimates.values()])

    @property
    def success(self) -> bool:
        """Whether every parameter that was looked for was found."""
        return not self.unidentified

    @property
    def message(self) -> str:
        """What came of it, in a sentence or two."""
        found = f"Found {', '.join(self.names)}."
        return " ".join([found, *(f"{name}: not identifiable, {why}." for name, why in self.unidentified.items())])

    @property
    def values(self) -> dict[str, float]:
        """Nominal values, replaced by the estimates where there are any."""
        known = {name: value.value for name, value in self.nominal.values.items()}
        return known | {name: estimate.value for name, estimate in self.estimates.items()}

    def parameter_file(self, provenance: Mapping[str, Any]) -> ParameterFile:
        """Return the parameter file to write: estimates, and nominal values of what could not be identified."""
        values: dict[str, Value] = {}
        for name in DEFINITIONS:
            if name in self.estimates:
                values[name] = Value(self.estimates[name].value, self.estimates[name].std)
            elif name in self.nominal.values:
                values[name] = self.nominal.values[name]
        found: dict[str, Any] = {"method": self.method, "samples": self.samples}
        if math.isfinite(self.path_rmse_after):
            found["path_rmse_m"] = round(self.path_rmse_after, 6)
        return ParameterFile(self.robot_id, values, provenance={**provenance, **found})

    def summary(self) -> str:
        """Return a table for a person."""
        lines = [
            f"Calibration of robot {self.robot_id}: {self.method}, {self.samples} samples",
            f"  {'parameter':13s} {'value':>11s} {'std':>9s} {'95 % interval':>24s}  unit",
        ]
        for name, definition in DEFINITIONS.items():
            if name in self.estimates:
                estimate = self.estimates[name]
                interval = "{:.5g} to {:.5g}".format(*estimate.interval)
                lines.append(
                    f"  {name:13s} {estimate.value:11.5g} {estimate.std:9.2g} {interval:>24s}  {definition.unit}"
                )
            elif name in self.unidentified:
                lines.append(f"  {name:13s} not identifiable: {self.unidentified[name]}")
            elif name in self.nominal.values:
                given = self.nominal.values[name].value
                lines.append(f"  {name:13s} {given:11.5g} {'':9s} {'as given':>24s}  {definition.unit}")
        if math.isfinite(self.path_rmse_after):
            before = f"{self.path_rmse_before:.4f} m" if math.isfinite(self.path_rmse_before) else "not known"
            lines.append(f"  path error    {before} before, {self.path_rmse_after:.4f} m after (root mean square)")
        return "\n".join([*lines, *(f"  {note}" for note in self.notes)])

    def plot(self) -> "Figure":
        """Return a figure: the path before and after, residuals in time, and the error surface of the grid."""
        from cmr.calibration.plots import figure_of

        return figure_of(self)
