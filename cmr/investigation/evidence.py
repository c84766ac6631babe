"""All measurements so far as one problem, with priors of the robot's parameters and of the effects.

Priors are further white errors: (value - mean) / deviation of each parameter. So the estimator's fits find the most
likely values, and what a few seconds of driving do not determine stays at its prior mean.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from cmr.estimation.candidates import Excitation, size
from cmr.estimation.gains import USUAL_ANGLE, USUAL_POSE, gains_at, interval_of
from cmr.estimation.noise import Noise
from cmr.estimation.prediction import Errors, Predictor, predictors
from cmr.estimation.problem import Problem
from cmr.estimation.segments import segments_of
from cmr.investigation.resting import with_rests
from cmr.model.catalogue import CATALOGUE, definition
from cmr.model.observer.observer import Gains
from cmr.model.parameters import Quantity
from cmr.parameters.file import ParameterFile
from cmr.recordings.recording import Recording
from cmr.recordings.signal import Floats, Mask

PARAMETERS = ("k2_over_k3", "k1", "base_width")
DOUBT = {"k2_over_k3": 0.30, "k1": 0.15, "base_width": 0.15}  # share by which data sheets are wrong
SIZES = 2.5  # typical sizes: standard deviation of the sizes of effects
PATCH_RADIUS, PATCH_DOUBT = 0.4, 0.125  # m
LARGEST_PAST = 1.0 / 20.0  # share of the drive: longest past for predicting errors; in a short drive, more fits chance
OF_PRIORS = -1  # the fold of the priors' errors
TURNING = 2.0  # rad/s, of usual turns
Place = tuple[float, float, float]  # x, y [m], theta [rad]
Prior = Mapping[str, tuple[float, float]]  # mean and standard deviation, by parameter


class Beliefs(Problem):
    """A problem in which parameters have a normal `prior`; the last rows of its white errors are theirs.

    `own` are the robot's own parameters, which are free in every explanation.
    """

    def __init__(
        self,
        predictors: Sequence[Predictor],
        gains: Gains,
        excitation: Excitation,
        prior: Prior,
        own: Sequence[str] = PARAMETERS,
    ) -> None:
        super().__init__(predictors, gains, excitation)
        self.prior, self.own = prior, tuple(own)

        # Distance of neutral values: effects that are off need no evaluation.
        neutral = [(definition(name).neutral, *about) for name, about in prior.items()]
        self._away = np.array([np.nan if value is None else (value - mean) / std for value, mean, std in neutral])

        # All priors are left out together, as a fold of their own.
        self.folds = np.concatenate([self.folds, np.full(len(prior), OF_PRIORS)])

    @property
    def rows_of_data(self) -> int:
        """The number of white errors of readings."""
        return self.batch.rows

    @property
    def last(self) -> float:
        """The time of the newest data: the duration of the drive so far [s]."""
        newest = self.predictors[-1].segment.observations
        return newest.time + newest.seconds

    def since(self, moment: float) -> Mask:
        """Return which white errors of readings are newer than a moment that was the last one once, shape (n,)."""
        return np.concatenate(
            [
                times + predictor.segment.observations.time > moment
                for predictor in self.predictors
                for times in predictor.times.values()
            ]
        )

    def found(self, errors: Sequence[Errors]) -> Noise:
        """Return the noise of the first candidate's errors in each segment, as far as so few errors determine it."""
        joined = self.batch.joined(errors)
        return with_rests(Noise.found(self.batch, joined, LARGEST_PAST), self.batch, joined)

    def white(self, values: Mapping[str, Quantity], noise: Noise) -> Floats:
        """Return all prediction errors, whitened and tempered, then those of the priors, shape (n, C)."""
        white = super().white(values, noise)
        away = np.repeat(self._away[:, None], white.shape[1], axis=1)
        for row, (name, (mean, std)) in enumerate(self.prior.items()):
            if name in values:
                away[row] = (np.asarray(values[name]) - mean) / std
        return np.concatenate([white, away])


def prior_of(
    nominal: Mapping[str, float], excitation: Excitation, floor_extent: float
) -> dict[str, tuple[float, float]]:
    """Return the priors: of the paper's parameters from the `nominal` ones, of effects from usual sizes.

    Places of a patch lie on the floor, roughly within `floor_extent` [m] of its middle.
    """
    own = {name: (nominal[name], share * nominal[name]) for name, share in DOUBT.items()}
    return own | prior_of_effects(excitation, floor_extent)


def prior_of_effects(excitation: Excitation, extent: float) -> dict[str, tuple[float, float]]:
    """Return the priors of effects: usual sizes; places of a patch roughly within `extent` [m]."""
    prior: dict[str, tuple[float, float]] = {}
    for effect in CATALOGUE.values():
        for parameter in effect.parameters:
            if parameter.switches and not parameter.is_limit:
                prior[parameter.name] = (float(parameter.neutral or 0.0), SIZES * size(parameter, excitation))
    of_a_place = {"x": (0.0, extent), "y": (0.0, extent), "radius": (PATCH_RADIUS, PATCH_DOUBT)}
    parameters = (parameter for effect in CATALOGUE.values() for parameter in effect.parameters)
    return prior | {one.name: of_a_place[one.kind] for one in parameters if one.kind in of_a_place}


def beliefs_of(
    recording: Recording, nominal: ParameterFile, extent: float, start: Place = (0.0, 0.0, 0.0)
) -> Beliefs | None:
    """Return the problem of a recording; None while the recording is too short.

    `nominal` gives wheel_radius, k2_over_k3, k1 and base_width, `extent` [m] half the size of the floor. Without poses
    the drive begins at `start`: x, y [m], theta [rad].
    """
    segments = segments_of(recording, (), 0)
    if not segments:
        return None
    if not len(recording.poses):
        observations = segments[0].observations
        begun = replace(observations, start=(*start, *observations.start[3:]))
        segments[0] = replace(segments[0], observations=begun)
    values = {name: nominal.value(name) for name in ("wheel_radius", *PARAMETERS)}
    ready = predictors(segments)
    interval = interval_of(ready)
    excitation = Excitation(values, turning=TURNING, extent=extent, interval=_pose_interval(ready))
    gains = gains_at(USUAL_ANGLE, USUAL_POSE, interval)
    return Beliefs(ready, gains, excitation, prior_of(values, excitation, extent))


def _pose_interval(ready: Sequence[Predictor]) -> float:
    """Return the usual time [s] between poses."""
    steps = [np.diff(one.segment.observations.pose_time) for one in ready]
    return float(np.median(np.concatenate(steps))) if any(map(len, steps)) else 0.04
