"""The result of a diagnosis: verdict, causes with evidence, extended parameters, gain."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from html import escape
from pathlib import PurePath

from cmr.estimation.estimates import Estimate
from cmr.estimation.gain import Gain
from cmr.estimation.laws.result import Laws
from cmr.estimation.search.trace import Decision, Measure
from cmr.estimation.unexplained.result import Unexplained
from cmr.recordings.faults.findings import Finding
from cmr.recordings.lateness import Lateness
from cmr.recordings.signal import Floats

EFFECTS_FOUND, NO_EFFECT, UNEXPLAINED, BAD_DATA = "effects_found", "no_effect", "unexplained", "bad_data"
LAW_FOUND = "law_found"  # a law stands in the model, and no name of the catalogue
PARAMETERS_DIFFER = "parameters_differ"  # only against a parameter file: no effect departs from it, parameters do
GENERIC = "a generic term, no physical cause"  # label of such a term everywhere
VERDICTS = (EFFECTS_FOUND, LAW_FOUND, NO_EFFECT, UNEXPLAINED, BAD_DATA, PARAMETERS_DIFFER)


@dataclass(frozen=True, kw_only=True)
class NamedEffect:
    """An effect that the data support.

    `estimates` are its parameters by name. `statistic` is twice the log-likelihood that the effect adds to the model
    with all other effects named, `p_value` the probability of such a value by chance for any effect in the catalogue.
    `held_out` is the log-likelihood gained on left-out data. `shift` is the change of each parameter of the paper's
    model, in its unit, when the effect was added to the baseline with all effects ordered before it. All shifts
    together, and that of a generic term, add up to the difference between the baseline and the fit with all of them;
    the average over undetected effects differs slightly from that fit. `indistinguishable_from` are effects that
    explain these data as well, `next_experiment` the manoeuvre that would distinguish them, or sharpen the estimate;
    None if nothing is open. `given` are its parameters in the parameter file that the robot is compared with, by name:
    empty without such a file, or if it lacks the effect.
    """

    name: str
    cause: str
    estimates: Mapping[str, Estimate]
    statistic: float
    p_value: float
    held_out: float = math.nan
    shift: Mapping[str, float] = field(default_factory=dict)
    indistinguishable_from: tuple[str, ...] = ()
    next_experiment: str | None = None
    given: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Departure:
    """A parameter of the paper's model, or of a velocity controller, that differs from the file's `given` value."""

    name: str
    given: float
    estimate: Estimate


@dataclass(frozen=True, kw_only=True)
class Against:
    """The parameter file whose robot, effects included, is the baseline: its path, SHA-256 and effects.

    `departures` are the parameters that differ from the file, besides those of named effects.
    """

    source: str
    sha256: str
    effects: tuple[str, ...] = ()
    departures: tuple[Departure, ...] = ()

    @property
    def name(self) -> str:
        """The name of the file, without its folder."""
        return PurePath(self.source).name


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """An effect that was tested but not named, with its evidence beside the named effects.

    `statistic` and `held_out` are as in NamedEffect; `why_not` is a sentence, `measure` the deciding number in it, None
    if unknown. `estimates` are the effect's fitted parameters by name. `harmless` says that the effect is significant
    but too small to matter.
    """

    name: str
    statistic: float
    p_value: float
    held_out: float
    why_not: str
    estimates: Mapping[str, Estimate] = field(default_factory=dict)
    harmless: bool = False
    measure: Measure | None = None


@dataclass(frozen=True, kw_only=True)
class Fitted:
    """A model fitted to the recordings.

    `estimates` are its parameters by name: the paper's that the data determine, and those of effects. `path_rmse` [m]
    is the root mean square distance from the real path of free runs over windows of `Evidence.window` seconds, each
    begun at the real state; `held_out_path_rmse` the same on data that the parameters were not fitted on, and
    `held_out_path_median` [m] the median over those windows of each one's root mean square distance.
    `held_out_heading_rmse` and `held_out_heading_median` [rad] are the same of the heading.
    """

    estimates: Mapping[str, Estimate]
    path_rmse: float
    held_out_path_rmse: float
    held_out_path_median: float = math.nan
    held_out_heading_rmse: float = math.nan
    held_out_heading_median: float = math.nan


@dataclass(frozen=True, kw_only=True)
class Path:
    """The path of one piece of a recording, and the free runs of the models from its measured start, all of shape (n,).

    Positions in [m], headings [rad, unwrapped], `time` [s] since the recording's first sample. `label` names the
    recording, `piece` counts its pieces from 1 to `pieces`.
    """

    label: str
    time: Floats
    x: Floats
    y: Floats
    theta: Floats
    before_x: Floats
    before_y: Floats
    before_theta: Floats
    after_x: Floats
    after_y: Floats
    after_theta: Floats
    piece: int = 1
    pieces: int = 1


@dataclass(frozen=True, kw_only=True)
class Residual:
    """Measured minus predicted values of a signal, shape (n,), and the state at those times.

    `signal` is one of psi_left, psi_right, yaw_rate, forward, sideways, heading; `unit` that of `before` (paper's
    model) and `after` (extended model; the same as `before` where nothing was found). `regressors` are arrays (n,) by
    name: time, command_left, command_right, speed, yaw_rate, speed_times_yaw_rate, x, y, heading, wheel_angle_left,
    wheel_angle_right, energy, ... Pose residuals are errors accumulated over windows of a second. `without` are, by
    effect, the residuals (n,) of the extended model with only that effect switched off.
    """

    signal: str
    unit: str
    before: Floats
    after: Floats
    regressors: Mapping[str, Floats]
    without: Mapping[str, Floats] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """Data for the report: paths of some of the `pieces`, residuals, and the length of free-run windows [s]."""

    window: float
    paths: tuple[Path, ...] = ()
    pieces: int = 0
    residuals: tuple[Residual, ...] = ()


NOTHING_TO_DRAW = Evidence(window=math.nan)


@dataclass(frozen=True, kw_only=True, repr=False)
class Diagnosis:
    """The diagnosis of one robot.

    `effects` are ordered by evidence, `candidates` are the runners-up. `laws` are laws for physics that is not in the
    catalogue. `baseline` is the paper's model, `extended` that with the effects named, laws and any generic term, both
    None with bad data. `parameters` holds all values the extended model runs with, by name. `checks` are the problems
    of the data, `notes` further sentences for the reader, `next_experiment` is the recommended drive if nothing, or not
    enough, was found, `not_visible` are effects that these drives could not reveal. `sources` names the recordings,
    `samples` counts what the models were fitted to. `nominal` is the robot as given, and `gain_over_nominal` the
    extended model's gain over it; both are None if too little was given. `lateness` is the measured delay of commands,
    by name of the recording. `decisions` are the steps of the search, in their order. `against` is the parameter file
    whose robot is the `baseline`, and from which the named effects are differences; None if the baseline is the paper's
    model.
    """

    robot_id: int
    verdict: str
    sentence: str
    baseline: Fitted | None = None
    extended: Fitted | None = None
    effects: tuple[NamedEffect, ...] = ()
    candidates: tuple[Candidate, ...] = ()
    gain: Gain | None = None
    nominal: Fitted | None = None
    gain_over_nominal: Gain | None = None
    laws: Laws = field(default_factory=Laws)
    unexplained: Unexplained = field(default_factory=Unexplained)
    checks: tuple[Finding, ...] = ()
    notes: tuple[str, ...] = ()
    next_experiment: str | None = None
    not_visible: tuple[str, ...] = ()
    parameters: Mapping[str, float] = field(default_factory=dict)
    evidence: Evidence = NOTHING_TO_DRAW
    sources: tuple[str, ...] = ()
    samples: int = 0
    decisions: tuple[Decision, ...] = ()
    lateness: Mapping[str, Lateness] = field(default_factory=dict)
    against: Against | None = None

    def __repr__(self) -> str:
        names = [*(effect.name for effect in self.effects), *(one.law.name for one in self.laws.found)]
        effects = ", ".join(names) or self.verdict
        return f"<{type(self).__name__} of robot {self.robot_id}: {effects}>"

    def _repr_html_(self) -> str:
        from cmr.diagnosis.summary import summary

        return f"<pre>{escape(summary(self))}</pre>"

    @property
    def lateness_sentences(self) -> list[str]:
        """Sentences on the delay of commands; with several recordings, each names its recording."""
        if len(self.lateness) == 1:
            return [one.sentence for one in self.lateness.values()]
        return [f"{name}: {one.sentence}" for name, one in self.lateness.items()]

    @property
    def harmless(self) -> list[Candidate]:
        """The effects that are significant but too small to matter."""
        return [candidate for candidate in self.candidates if candidate.harmless]

    @property
    def is_extended(self) -> bool:
        """Whether the extended model differs from the baseline."""
        departs = self.against is not None and bool(self.against.departures)
        found = bool(self.effects) or bool(self.laws.found)
        return found or self.unexplained.generic is not None or departs

    @property
    def baseline_words(self) -> str:
        """The name of the baseline."""
        return "the paper's model" if self.against is None else f"the robot of {self.against.name}"
