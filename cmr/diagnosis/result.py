"""What a diagnosis found: the verdict, the causes and their evidence, the extended parameters, the gain."""

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
GENERIC = "a generic term, no physical cause"  # how such a term is labelled everywhere
VERDICTS = (EFFECTS_FOUND, LAW_FOUND, NO_EFFECT, UNEXPLAINED, BAD_DATA, PARAMETERS_DIFFER)


@dataclass(frozen=True, kw_only=True)
class NamedEffect:
    """An effect that the data show.

    `estimates` are its parameters by name. `statistic` is twice the log-likelihood that the effect adds to the model
    with all other effects named, `p_value` how often chance alone would give as much somewhere in the catalogue.
    `held_out` is the log-likelihood that it adds on data it was not fitted on. `shift` says how far each parameter
    of the paper's model moved, in its unit, when the effect was added to the baseline with all effects ordered before
    it. All shifts together, and that of a generic term, are what lies between the baseline and the fit with all of
    them; the average over what may be hidden besides lies a little beside that fit.
    `indistinguishable_from` are effects that explain these data as well, `next_experiment` the manoeuvre that would
    distinguish them, or sharpen the estimate; None if nothing is left to find out. `given` are its parameters in the
    parameter file that the robot is compared with, by name: empty without such a file, and where it lacks the effect.
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
    """A parameter of the paper's model, or of a velocity controller, that is another than in a file: `given` there."""

    name: str
    given: float
    estimate: Estimate


@dataclass(frozen=True, kw_only=True)
class Against:
    """The parameter file whose robot, effects included, is the baseline: where it is, its SHA-256, its effects.

    `departures` are the parameters that are others than in the file, beside those of the effects named.
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
    """An effect of the catalogue that was tested and not named: its evidence beside the effects named.

    `statistic` and `held_out` are as in NamedEffect; `why_not` is a sentence, `measure` the number in it that decided,
    None if it is not known. `estimates` are the effect's parameters by name as they were fitted. `harmless` says that
    the data show the effect, but that it is too small to matter.
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
    """What one signal says minus what the models predict of it, shape (n,), and the state at that moment.

    `signal` is one of psi_left, psi_right, yaw_rate, forward, sideways, heading; `unit` that of `before` (paper's
    model) and `after` (extended model; the same as `before` where nothing was found). `regressors` are arrays (n,) by
    name: time, command_left, command_right, speed, yaw_rate, speed_times_yaw_rate, x, y, heading,
    wheel_angle_left, wheel_angle_right, energy, ... Those of the pose are errors grown over windows of a second.
    `without` says by effect what the extended model leaves (n,) when that one effect is switched off in it and all
    else stays.
    """

    signal: str
    unit: str
    before: Floats
    after: Floats
    regressors: Mapping[str, Floats]
    without: Mapping[str, Floats] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """What a report draws: paths of some of the `pieces`, residuals, and how long the windows of free runs are [s]."""

    window: float
    paths: tuple[Path, ...] = ()
    pieces: int = 0
    residuals: tuple[Residual, ...] = ()


NOTHING_TO_DRAW = Evidence(window=math.nan)


@dataclass(frozen=True, kw_only=True, repr=False)
class Diagnosis:
    """What a diagnosis found of one robot.

    `effects` are ordered by evidence, `candidates` are the runners-up. `laws` is the answer on physics that no entry of
    the catalogue describes. `baseline` is the paper's model, `extended` that with the effects named, laws and any
    generic term, both None with bad data. `parameters` holds all values the
    extended model runs with, by name. `checks` says what was wrong with the data, `notes` are sentences on what else a
    reader should know, `next_experiment` what to do next if nothing, or not enough, was found, `not_visible` all
    effects that would not show in these drives if the robot had them. `sources` names the recordings, `samples` counts
    what the models were fitted to. `nominal` is the robot as it was given, and
    `gain_over_nominal` what the extended model gains over it; both are None where too little of it was given.
    `lateness` says how late commands took effect, by the name of the recording in which it was measured. `decisions`
    are the steps of the search, in their order. `against` is the parameter file whose robot is the `baseline`, and
    from which the effects named depart; None where that is the paper's model.
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
        """How late commands took effect, in words; of several recordings, each sentence says in which."""
        if len(self.lateness) == 1:
            return [one.sentence for one in self.lateness.values()]
        return [f"{name}: {one.sentence}" for name, one in self.lateness.items()]

    @property
    def harmless(self) -> list[Candidate]:
        """The effects that the data show, but that are too small to matter."""
        return [candidate for candidate in self.candidates if candidate.harmless]

    @property
    def is_extended(self) -> bool:
        """Whether the extended model is another than the baseline."""
        departs = self.against is not None and bool(self.against.departures)
        found = bool(self.effects) or bool(self.laws.found)
        return found or self.unexplained.generic is not None or departs

    @property
    def baseline_words(self) -> str:
        """What the baseline is called."""
        return "the paper's model" if self.against is None else f"the robot of {self.against.name}"
