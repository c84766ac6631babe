"""Fit the path, and align the clocks of commands, wheels and poses at the same time."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cmr.calibration.grid import Grid, axes_for, search
from cmr.calibration.linear import COMMAND_TIME, POSE_TIME
from cmr.calibration.preparing import Prepared
from cmr.calibration.refine import Refined, Refinement
from cmr.calibration.segments import Segment
from cmr.estimation.estimates import Estimate
from cmr.recordings.signal import Floats

PAPER_PARAMETERS: tuple[str, ...] = ("k2_over_k3", "k1", "base_width")
ALIGNED = 5e-3  # s; smaller offsets need no correction: the refinement linearises them
ROUNDS = 4
WORTH_TELLING = 0.02  # s; a smaller offset may be friction or slip
POSES_LATE = "Poses are stamped {:.3f} s later than wheels and commands."
POSES_EARLY = "Poses are stamped {:.3f} s earlier than wheels and commands."
COMMANDS_LATE = "Commands take effect {:.3f} s later than they are stamped."
# No robot acts on a command before it is sent.
COMMANDS_EARLY = (
    "The path fits best if commands are taken {:.3f} s before their time stamps: their clock is ahead, or the robot "
    "does not answer as the motor model does."
)
TAKEN_INTO_ACCOUNT = " The calibration has taken this into account."


@dataclass(frozen=True)
class Fit:
    """The refined parameters, with the fitted segments and the preceding grid search, None without one."""

    refined: Refined
    segments: list[Segment]
    method: str
    grid: Grid | None = None
    notes: tuple[str, ...] = ()

    @property
    def correlation(self) -> Floats:
        """The correlation matrix of the estimates; 0 for undetermined ones."""
        spread = np.sqrt(np.diag(self.refined.covariance))
        scale = np.where(np.isfinite(spread) & (spread > 0.0), spread, np.inf)
        return np.asarray(np.nan_to_num(self.refined.covariance / np.outer(scale, scale)))


def fit_by_path(
    prepared: Prepared,
    segments: list[Segment],
    names: tuple[str, ...],
    known: Mapping[str, float],
    first: Mapping[str, float] | None,
) -> Fit:
    """Find `names` among the paper's parameters from commands and path; the others are `known`.

    Raises EstimationError when commands and motion are inconsistent.
    """
    grid, method = None, "refine"
    if first is None:
        radius = known["wheel_radius"]
        grid = search(segments, radius, axes_for(segments, radius, known.get("base_width")))
        first, method = grid.best, "grid+refine"
    values = dict(first) | dict(known)
    return _aligned(prepared, segments, names, values, method, grid)


def _aligned(
    prepared: Prepared,
    segments: list[Segment],
    names: tuple[str, ...],
    values: Mapping[str, float],
    method: str,
    grid: Grid | None,
) -> Fit:
    """Refine; if the fit shows a clock offset, correct it and refine again."""
    for _round in range(ROUNDS):
        rough = _refinement(prepared, segments, names, values).solve(rounds=1)
        values = dict(values) | {name: estimate.value for name, estimate in rough.estimates.items()}
        offsets = {name: rough.nuisance[name] for name in (COMMAND_TIME, POSE_TIME) if name in rough.nuisance}
        off = {n: e.value for n, e in offsets.items() if abs(e.value) > max(ALIGNED, 3.0 * e.std)}
        if not off:
            break
        prepared = prepared.shifted(commands=off.get(COMMAND_TIME, 0.0), poses=-off.get(POSE_TIME, 0.0))
        segments = prepared.segments()
    refined = _refinement(prepared, segments, names, values).solve()
    offsets = {name: refined.nuisance[name] for name in (COMMAND_TIME, POSE_TIME) if name in refined.nuisance}
    return Fit(refined, segments, method, grid, _statements(prepared, offsets))


def _refinement(
    prepared: Prepared, segments: list[Segment], names: tuple[str, ...], values: Mapping[str, float]
) -> Refinement:
    return Refinement(segments, names, values, prepared.pose_clock_std, prepared.command_clock_std)


def _statements(prepared: Prepared, offsets: Mapping[str, Estimate]) -> tuple[str, ...]:
    """Return sentences on significant clock offsets."""
    notes = []
    for name, shift, late, early in (
        (POSE_TIME, -prepared.poses_shifted, POSES_LATE, POSES_EARLY),
        (COMMAND_TIME, prepared.commands_shifted, COMMANDS_LATE, COMMANDS_EARLY),
    ):
        if name in offsets:
            total = shift + offsets[name].value
            if abs(total) > max(WORTH_TELLING, 3.0 * offsets[name].std):
                notes.append((late if total > 0.0 else early).format(abs(total)) + TAKEN_INTO_ACCOUNT)
    return tuple(notes)
