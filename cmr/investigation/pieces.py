"""Look at pieces of recordings one after the other, each time at the one that separates best what is left.

Of a piece that was not looked at only its inputs are known: commands, or wheel speeds where none were recorded. What
its sensors would tell is predicted as for a movement that a robot might drive.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from cmr.estimation.candidates import Excitation
from cmr.estimation.checks import looked_at
from cmr.estimation.gains import USUAL_ANGLE, USUAL_POSE, gains_at
from cmr.estimation.noise import FOREIGN, Noise, SignalNoise
from cmr.estimation.prediction import predictors
from cmr.estimation.preparation import prepare
from cmr.estimation.problem import Problem
from cmr.estimation.segments import Segment, segments_of
from cmr.geometry.manoeuvres import TYPICAL
from cmr.investigation import separation
from cmr.investigation.choosing import column_sets, told, worth_of
from cmr.investigation.evidence import PARAMETERS, TURNING, Beliefs, prior_of_effects
from cmr.investigation.judging import Judgement
from cmr.investigation.naming import Naming
from cmr.investigation.prediction import changes_in, reading_times, with_readings
from cmr.investigation.separation import ENOUGH
from cmr.model.observer.observer import Gains, Observations
from cmr.parameters.file import ParameterFile
from cmr.recordings.recording import Recording
from cmr.recordings.signal import SECONDS, Floats, Mask

SHORTEST = 1.5  # s: with what is known beforehand of effects, less is enough than a diagnosis takes
# Share by which parameters are off; robots that slip as they turn count with up to twice the width of their base.
DOUBT = {"wheel_radius": 0.15, "k2_over_k3": 0.30, "k1": 0.15, "base_width": 1.0}
# Of sensors of which nothing was seen yet: s between readings of wheels, gyro and poses, and the size of their noise.
USUAL_INTERVALS = (0.02, 0.02, 0.1)
SIZES = {"yaw_rate": 0.01, "forward": 0.01, "sideways": 0.01, "heading": 0.01, "psi_left": 0.02, "psi_right": 0.02}
USUAL_NOISE = Noise(
    {name: SignalNoise(np.empty(0), np.zeros(len(FOREIGN)), (np.array([size]),)) for name, size in SIZES.items()}
)
MOST_PREDICTED = 120  # pieces whose information is predicted, drawn anew for each choice

Pieces = Mapping[int, Sequence[Segment]]  # by their numbers
Intervals = Sequence[float | None]  # s between readings of wheels, gyro and poses; None of a sensor that is missing


def inputs_of(piece: Recording) -> Recording:
    """Return what drove the robot: the commands, or the wheels where none were recorded."""
    moved = replace(piece, gyro=piece.gyro.between(0, 0), poses=piece.poses.between(0, 0))
    return replace(moved, wheels=piece.wheels.between(0, 0)) if len(piece.commands) else moved


class PieceByPiece:
    """Finds out what a robot's model gets wrong from pieces of recordings, and chooses the piece to look at next.

    `inputs` are those of each piece, as `inputs_of` returns them; commanded speeds stand as duties in them
    (`cmr.estimation.commanded_speeds.as_duties`). `nominal` gives at least wheel_radius. `left` are the numbers of the
    pieces that were not looked at. The first one is that whose inputs show most effects of the nominal robot, by usual
    sensors; with `at_random` all are drawn at random.
    """

    def __init__(
        self, inputs: Sequence[Recording], nominal: ParameterFile, *, seed: int = 0, at_random: bool = False
    ) -> None:
        self.left = list(range(len(inputs)))
        self.naming = Naming()
        self._inputs, self._nominal = list(inputs), nominal
        self._random, self._at_random = np.random.default_rng(seed), at_random
        self._looked_at: list[Recording] = []

    @property
    def named(self) -> tuple[str, ...]:
        """The effects found that stand at the odds of a name, and are large enough to matter."""
        return self.naming.named

    def look(self, number: int, piece: Recording) -> Judgement | None:
        """Return the judgement of all pieces looked at, and of this one; None while they are too short to judge."""
        self.left.remove(number)
        self._looked_at.append(piece)
        with threadpool_limits(1, "blas"):
            problem = beliefs_of_pieces(self._looked_at, self._nominal)
            return None if problem is None else self.naming.judged(problem)

    def choose(self) -> int | None:
        """Return the number of the piece to look at next; None where none is left."""
        if not self.left:
            return None
        drawn: list[int] = self._random.permutation(self.left).tolist()
        judgement = self.naming.judgement
        if self._at_random or (judgement is None and self._looked_at):
            return drawn[0]
        pieces = {number: segments_of(self._inputs[number], (), 0) for number in drawn[:MOST_PREDICTED]}
        pieces = {number: segments for number, segments in pieces.items() if segments}
        if not pieces:
            return drawn[0]
        with threadpool_limits(1, "blas"):
            worth = self._first(pieces) if judgement is None else self._next(pieces, judgement)
            return list(pieces)[int(np.argmax(worth))]

    def _first(self, pieces: Pieces) -> Floats:
        """Return what pieces are worth, (c,), before anything is known but the nominal robot."""
        problem = self._unseen(pieces)
        own = ("wheel_radius", "base_width") if self._rolls(pieces) else PARAMETERS
        values = problem.excitation.parameters
        sets, columns = column_sets(values, own, problem.effects, problem.excitation, as_fitted={})
        added = _added(pieces, sets, USUAL_INTERVALS, problem.gains, USUAL_NOISE)
        seen = separation.own(separation.projected(added, columns), columns)
        return np.asarray(np.sum(1.0 - np.exp(-2.0 * seen / ENOUGH), axis=1) / _seconds(pieces))

    def _next(self, pieces: Pieces, judgement: Judgement) -> Floats:
        """Return what pieces are worth, (c,), for what the ones looked at leave open."""
        known = told(judgement, 0.0)
        intervals = [self._interval(name) for name in ("wheels", "gyro", "poses")]
        added = _added(pieces, known.sets, intervals, judgement.problem.gains, judgement.noise)
        return worth_of(judgement, known, added, _seconds(pieces))

    def _rolls(self, pieces: Pieces) -> bool:
        return all(len(segment.observations.given) for segments in pieces.values() for segment in segments)

    def _unseen(self, pieces: Pieces) -> Problem:
        """Return the problem of the nominal robot with usual sensors, of which nothing was read."""
        typical = {name: float(getattr(TYPICAL, name)) for name in ("wheel_radius", *PARAMETERS)}
        known = {name: self._nominal.value(name) if self._nominal.has(name) else typical[name] for name in typical}
        gains = gains_at(USUAL_ANGLE, USUAL_POSE, USUAL_INTERVALS[0])
        read = [
            replace(segment, observations=_with_readings(segment.observations, USUAL_INTERVALS, known))
            for segments in pieces.values()
            for segment in segments
        ]
        return Problem(predictors(read), gains, Excitation(known, turning=TURNING))

    def _interval(self, name: str) -> float | None:
        """Return the usual time [s] between readings in the pieces looked at; None where there are none."""
        steps = [np.diff(piece.signals[name].utime) for piece in self._looked_at]
        together = np.concatenate(steps) if steps else np.empty(0)
        return float(np.median(together)) * SECONDS if len(together) else None


def _seconds(pieces: Pieces) -> Floats:
    """Return how long the pieces last [s], (c,)."""
    return np.array([sum(one.observations.seconds for one in segments) for segments in pieces.values()])


def _added(
    pieces: Pieces, sets: Sequence[Mapping[str, float]], intervals: Intervals, gains: Gains, noise: Noise
) -> Floats:
    """Return the information (c, m, m) that each piece would add on m columns, those of `sets` but the first."""
    drives = [[_with_readings(one.observations, intervals, sets[0]) for one in of] for of in pieces.values()]
    told_by = iter(changes_in([drive for of in drives for drive in of], sets, gains, noise))
    return np.stack([sum(np.nan_to_num(one.T @ one) for one in (next(told_by) for _ in of)) for of in drives])


class _Pieces(Beliefs):
    """Beliefs in which data come in recording by recording: moments are how many recordings there were."""

    @property
    def last(self) -> float:
        """How many pieces were looked at."""
        return 1.0 + self.predictors[-1].segment.recording

    def since(self, moment: float) -> Mask:
        """Return which white errors of readings are of pieces that were looked at after so many, shape (n,)."""
        return np.concatenate(
            [
                np.full(sum(map(len, predictor.times.values())), predictor.segment.recording >= moment)
                for predictor in self.predictors
            ]
        )


def beliefs_of_pieces(pieces: Sequence[Recording], nominal: ParameterFile) -> Beliefs | None:
    """Return the problem of some pieces, checked like recordings for a diagnosis; None while they are too short.

    `nominal` gives wheel_radius. The robot's own parameters are those that the pieces determine. Those that `nominal`
    has are off by DOUBT.
    """
    ready = prepare(looked_at(pieces), nominal, shortest=SHORTEST)
    if ready.problem is None or ready.base is None:
        return None
    problem, excitation = ready.problem, ready.problem.excitation
    own = {
        name: (nominal.value(name), DOUBT[name] * nominal.value(name)) for name in ready.base.names if nominal.has(name)
    }
    prior = own | prior_of_effects(excitation, excitation.extent)
    return _Pieces(problem.predictors, problem.gains, excitation, prior, ready.base.names)


def _with_readings(drive: Observations, intervals: Intervals, values: Mapping[str, float]) -> Observations:
    """Return inputs as a drive on which sensors read at these `intervals` [s], None for one that is missing."""
    wheel, gyro, pose = (reading_times(interval, drive.seconds) for interval in intervals)
    if len(drive.given):
        return with_readings(drive, np.empty(0), gyro, pose, seen_first=True)
    # A piece that is cut out of a longer drive begins at about the speed that it is commanded.
    speeds = drive.duty[0] / values["k1"]
    begun = replace(drive, start=(0.0, 0.0, 0.0, float(speeds[0]), float(speeds[1])))
    return with_readings(begun, wheel, gyro, pose, seen_first=True)
