"""What a calibration found: estimates, what could not be identified and why, and the path error."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from cmr.model.parameters import DEFINITIONS
from cmr.parameters.file import ParameterFile, Value


class CalibrationError(Exception):
    """Nothing can be found from this data; the text says why and what to do."""


@dataclass(frozen=True)
class Estimate:
    """A parameter's estimated value and standard deviation, in the parameter's unit."""

    value: float
    std: float


@dataclass(frozen=True)
class CalibrationResult:
    """What was found of one robot.

    `unidentified` tells, by parameter, why the data does not determine it. `path_rmse_before` and
    `path_rmse_after` are the root mean square distances [m] between the real path and the one simulated with the
    nominal and with the found parameters, NaN where there is no path to compare. `nominal` is what was known before.
    """

    robot_id: int
    estimates: Mapping[str, Estimate]
    unidentified: Mapping[str, str]
    nominal: ParameterFile
    method: str
    samples: int
    path_rmse_before: float = math.nan
    path_rmse_after: float = math.nan
    notes: tuple[str, ...] = field(default_factory=tuple)

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
        lines = [f"robot {self.robot_id}, {self.samples} samples, {self.method}"]
        for name, definition in DEFINITIONS.items():
            if name in self.estimates:
                estimate = self.estimates[name]
                lines.append(f"  {name:13s} {estimate.value:12.6g} +- {estimate.std:<10.2g} {definition.unit}")
            elif name in self.unidentified:
                lines.append(f"  {name:13s} not identifiable: {self.unidentified[name]}")
            elif name in self.nominal.values:
                lines.append(f"  {name:13s} {self.nominal.values[name].value:12.6g} (as given)  {definition.unit}")
        if math.isfinite(self.path_rmse_after):
            before = f"{self.path_rmse_before:.4f} m" if math.isfinite(self.path_rmse_before) else "not known"
            lines.append(f"  path error    {before} before, {self.path_rmse_after:.4f} m after (root mean square)")
        return "\n".join([*lines, *(f"  {note}" for note in self.notes)])
