"""The result of a calibration: estimates, unidentifiable parameters with reasons, and the path error."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from html import escape
from typing import TYPE_CHECKING

from cmr.estimation.commanded_speeds import correlation_of_motor, in_words_of, values_in_words_of
from cmr.estimation.estimates import Estimate, EstimationError
from cmr.estimation.free_runs import WINDOW
from cmr.model.catalogue import definition, effects_on
from cmr.model.parameters import DEFINITIONS
from cmr.model.velocity_controller import CONTROLLER_DEFINITIONS, VelocityController
from cmr.parameters.file import ParameterFile, Value
from cmr.recordings.recording import Recording
from cmr.recordings.signal import Floats

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from cmr.calibration.grid import Grid
    from cmr.calibration.segments import Segment

GRID = "grid"  # the method of a result that is the least error of a grid, not refined
EFFECTS = "effects in use: those that the drive shows, and what others that it may hide come to on average"

NO_MINIMUM = (
    "No file is written: the error surface of the paper's method has no minimum, its least error is at the edge of the "
    "grid ({}). The paper's model does not explain this drive as a whole. Leave out --method paper to find the "
    "parameters beside what bends the path; --picture FILE draws the surface."
)


def tells(estimate: Estimate) -> bool:
    """Return whether an estimate of a positive parameter is informative: its 95 % interval is positive."""
    return estimate.interval[0] > 0.0


@dataclass(frozen=True, kw_only=True, repr=False)
class CalibrationResult:
    """The calibration of one robot.

    `estimates` holds each identified parameter's value and standard deviation. `covariance` [products of units] is
    theirs, in their order. `unidentified` gives, by parameter, why the data do not determine it. `nominal` are the
    prior values, `samples` how many measurements were compared. `path_rmse_before` and `path_rmse_after` are the root
    mean square distances [m] between the real path and the one simulated freely with the nominal and with the found
    parameters, over windows of 3 s (the paper's method: over the whole drive), NaN where there is no path to compare.
    `notes` are further remarks. `parameters` are all values for simulating the robot, `effects` the estimates of those
    of effects in use, both by name; without any, they are the nominal values and the estimates. `named` are the
    detected effects. `recordings` are the data, `segments` the same cut for the paper's method, `grid` the error
    surface of its grid search, None without one; `by_wheels` says that the path follows the measured wheels instead of
    the commands. `controller` is the robot's velocity controller, None if it takes duties; k2_over_k3 and k1 then
    represent it, and file and summary contain its own parameters.
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
    recordings: tuple[Recording, ...] = field(default=(), repr=False)
    parameters: Mapping[str, float] = field(default_factory=dict)
    effects: Mapping[str, Estimate] = field(default_factory=dict)
    named: tuple[str, ...] = ()
    by_wheels: bool = False
    controller: VelocityController | None = None

    @property
    def values(self) -> dict[str, float]:
        """Nominal values of the paper's parameters, replaced by what was found, and those of effects in use."""
        known = {name: value.value for name, value in self.nominal.values.items() if name in DEFINITIONS}
        return known | dict(self.parameters) | {name: estimate.value for name, estimate in self.estimates.items()}

    @property
    def why_no_file(self) -> str:
        """Why these values are not those of a robot, in a sentence that says what to do; empty if a file may be
        written.
        """
        at_the_edge = self.grid.at_the_edge if self.grid is not None and self.method == GRID else ()
        values = [f"{name} {self.values[name]:.4g} {DEFINITIONS[name].unit}" for name in at_the_edge]
        return NO_MINIMUM.format(", ".join(values)) if values else ""

    def parameter_file(self, provenance: Mapping[str, object]) -> ParameterFile:
        """Return the parameter file to write: estimates with the effects in use, and nominal values of the rest.

        Raises EstimationError with `why_no_file`.
        """
        if self.why_no_file:
            raise EstimationError(self.why_no_file)
        values = {
            name: self._written(name, value) for name, value in values_in_words_of(self.values, self.controller).items()
        }
        in_use = effects_on(self.values)
        found: dict[str, object] = {"method": self.method, "samples": self.samples}
        if math.isfinite(self.path_rmse_after):
            found["path_rmse_m"] = round(self.path_rmse_after, 6)
        return ParameterFile(self.robot_id, values, tuple(one.name for one in in_use), {**provenance, **found})

    @property
    def reported(self) -> dict[str, Estimate]:
        """The estimates under the names in the robot's file."""
        return in_words_of(self.estimates, self.controller, correlation_of_motor(list(self.estimates), self.covariance))

    def _written(self, name: str, value: float) -> Value:
        """Return a value for the file: with its standard deviation, or as given."""
        reported, given = {**self.reported, **self.effects}, self.nominal.values.get(name)
        if name in reported:
            return Value(value, reported[name].std)
        return given if given is not None and given.value == value else Value(value)

    def to_dict(self) -> dict[str, object]:
        """Return the result as plain values, for JSON, in the units of the parameter file."""
        return {
            "robot_id": self.robot_id,
            "method": self.method,
            "samples": self.samples,
            "parameters": values_in_words_of(self.values, self.controller),
            "std": {name: estimate.std for name, estimate in {**self.effects, **self.reported}.items()},
            "unidentified": dict(self.unidentified),
            "effects_shown": list(self.named),
            "path_rmse_before_m": self.path_rmse_before,
            "path_rmse_after_m": self.path_rmse_after,
            "notes": list(self.notes),
        }

    def __repr__(self) -> str:
        return f"<{type(self).__name__} of robot {self.robot_id}: path error {self.path_rmse_after:.4f} m>"

    def _repr_html_(self) -> str:
        return f"<pre>{escape(self.summary())}</pre>"

    def summary(self) -> str:
        """Return a table as text."""
        lines = [f"Calibration of robot {self.robot_id}: {self.method}, {self.samples} samples", *self._table()]
        effects = [name for name in values_in_words_of(self.values, self.controller) if self._is_of_effect(name)]
        lines += ["", f"  {EFFECTS}"] if effects else []
        lines += [self._line(name) for name in effects]
        if math.isfinite(self.path_rmse_after):
            before = f"{self.path_rmse_before:.4f} m" if math.isfinite(self.path_rmse_before) else "not known"
            over = f"over {WINDOW:g} s" if self.recordings else "over the whole drive"
            lines.append(
                f"  path error    {before} before, {self.path_rmse_after:.4f} m after (root mean square {over})"
            )
        return "\n".join([*lines, *(f"  {note}" for note in self.notes)])

    def _table(self) -> list[str]:
        """Return the lines of the parameters that every robot of this kind has."""
        reported, values = self.reported, values_in_words_of(self.values, self.controller)
        known = {**DEFINITIONS, **CONTROLLER_DEFINITIONS} if self.controller else DEFINITIONS
        width = 18 if self.controller else 13
        lines = [f"  {'parameter':{width}s} {'value':>11s} {'std':>9s} {'95 % interval':>24s}  unit"]
        for name, parameter in known.items():
            start = f"  {name:{width}s}"
            if name in reported:
                estimate = reported[name]
                interval = "{:.5g} to {:.5g}".format(*estimate.interval)
                lines.append(f"{start} {estimate.value:11.5g} {estimate.std:9.2g} {interval:>24s}  {parameter.unit}")
            elif name in self.unidentified:
                lines.append(f"{start} not identifiable: {self.unidentified[name]}")
            elif name in values and (name in self.nominal.values or name in CONTROLLER_DEFINITIONS):
                origin = "as given" if name in self.nominal.values else "of the commands"
                lines.append(f"{start} {values[name]:11.5g} {'':9s} {origin:>24s}  {parameter.unit}")
        return lines

    def _is_of_effect(self, name: str) -> bool:
        return name not in DEFINITIONS and name not in CONTROLLER_DEFINITIONS

    def _line(self, name: str) -> str:
        """Return the line of an effect's parameter."""
        deviation = f"{self.effects[name].std:9.2g}" if name in self.effects else " " * 9
        return f"  {name:24s} {self.values[name]:11.4g} {deviation}  {definition(name).unit}"

    def plot(self) -> "Figure":
        """Return a figure: the path before and after, residuals in time, and the error surface of the grid."""
        from cmr.calibration.plots import figure_of

        return figure_of(self)
