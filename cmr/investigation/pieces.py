"""Examine pieces of recordings one by one, each time the one that best separates the remaining explanations.

Of an unexamined piece only the inputs are known: commands, or wheel speeds if none were recorded. Its sensor readings
are predicted as for a movement that a robot might drive.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from cmr.estimation.checks import looked_at
from cmr.estimation.preparation import prepare
from cmr.estimation.segments import segments_of
from cmr.investigation.choosing import evidence_of, worth_of
from cmr.investigation.evidence import Beliefs, prior_of_effects
from cmr.investigation.judging import Judgement
from cmr.investigation.naming import Naming
from cmr.investigation.prediction import changes_in, reading_times, with_readings
from cmr.model.observer.observer import Observations
from cmr.parameters.file import ParameterFile
from cmr.recordings.recording import Recording
from cmr.recordings.signal import SECONDS, Mask

SHORTEST = 1.5  # s: with priors of effects, less is enough than a diagnosis needs
# Relative deviations of parameters; with slip in turns, the base may appear twice as wide.
DOUBT = {"wheel_radius": 0.15, "k2_over_k3": 0.30, "k1": 0.15, "base_width": 1.0}
MOST_PREDICTED = 120  # pieces whose information is predicted; others are drawn at each choice


def inputs_of(piece: Recording) -> Recording:
    """Return the inputs of a drive: the commands, or the wheels if none were recorded."""
    moved = replace(piece, gyro=piece.gyro.between(0, 0), poses=piece.poses.between(0, 0))
    return replace(moved, wheels=piece.wheels.between(0, 0)) if len(piece.commands) else moved


class PieceByPiece:
    """Finds out what a robot's model gets wrong from pieces of recordings, and chooses the next piece to examine.

    `inputs` are those of each piece, as `inputs_of` returns them; commanded speeds stand as duties in them
    (`cmr.estimation.commanded_speeds.as_duties`). `nominal` gives at least wheel_radius. `left` are the numbers of the
    unexamined pieces. They are drawn at random until the first ones can be judged, and always with `at_random`.
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
        """The effects found that still reach the odds of a name and are large enough to matter."""
        return self.naming.named

    def look(self, number: int, piece: Recording) -> Judgement | None:
        """Return the judgement of all examined pieces with this one; None while they are too short to judge."""
        self.left.remove(number)
        self._looked_at.append(piece)
        with threadpool_limits(1, "blas"):
            problem = beliefs_of_pieces(self._looked_at, self._nominal)
            return None if problem is None else self.naming.judged(problem)

    def choose(self) -> int | None:
        """Return the number of the next piece to examine; None if none is left."""
        if not self.left:
            return None
        drawn: list[int] = self._random.permutation(self.left)[:MOST_PREDICTED].tolist()
        judgement = self.naming.judgement
        if self._at_random or judgement is None:
            return drawn[0]
        with threadpool_limits(1, "blas"):
            return self._best(drawn, judgement)

    def _best(self, numbers: Sequence[int], judgement: Judgement) -> int:
        """Return the number of the piece whose inputs promise most for its length."""
        known = evidence_of(judgement, 0.0)
        intervals = [self._interval(name) for name in ("wheels", "gyro", "poses")]
        drives, of = [], []
        for number in numbers:
            for segment in segments_of(self._inputs[number], (), 0):
                drives.append(_with_readings(segment.observations, intervals, known.sets[0]))
                of.append(number)
        if not drives:
            return int(numbers[0])
        told_by = changes_in(drives, known.sets, judgement.problem.gains, judgement.noise)
        added = np.zeros((len(numbers), *known.information.shape))
        seconds = np.zeros(len(numbers))
        for number, drive, one in zip(of, drives, told_by, strict=True):
            added[numbers.index(number)] += np.nan_to_num(one.T @ one)
            seconds[numbers.index(number)] += drive.seconds
        told_anything = seconds > 0.0
        worth = worth_of(judgement, known, added, np.where(told_anything, seconds, 1.0))
        return int(numbers[int(np.argmax(np.where(told_anything, worth, -1.0)))])

    def _interval(self, name: str) -> float | None:
        """Return the usual time [s] between readings in the examined pieces; None without any."""
        steps = [np.diff(piece.signals[name].utime) for piece in self._looked_at]
        together = np.concatenate(steps) if steps else np.empty(0)
        return float(np.median(together)) * SECONDS if len(together) else None


class _Pieces(Beliefs):
    """Beliefs with data added recording by recording: a moment is the number of recordings so far."""

    @property
    def last(self) -> float:
        """The number of examined pieces."""
        return 1.0 + self.predictors[-1].segment.recording

    def since(self, moment: float) -> Mask:
        """Return which white errors of readings belong to pieces examined after so many, shape (n,)."""
        return np.concatenate(
            [
                np.full(sum(map(len, predictor.times.values())), predictor.segment.recording >= moment)
                for predictor in self.predictors
            ]
        )


def beliefs_of_pieces(pieces: Sequence[Recording], nominal: ParameterFile) -> Beliefs | None:
    """Return the problem of some pieces, checked like recordings for a diagnosis; None while they are too short.

    `nominal` gives wheel_radius. The robot's own parameters are those that the pieces determine. Those in `nominal`
    have the relative deviation DOUBT.
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


def _with_readings(drive: Observations, intervals: Sequence[float | None], values: Mapping[str, float]) -> Observations:
    """Return inputs as a drive with sensor readings at these `intervals` [s], None for a missing sensor."""
    wheel, gyro, pose = (reading_times(interval, drive.seconds) for interval in intervals)
    if len(drive.given):
        return with_readings(drive, np.empty(0), gyro, pose, seen_first=True)
    # A piece cut out of a longer drive begins at about its commanded speed.
    speeds = drive.duty[0] / values["k1"]
    begun = replace(drive, start=(0.0, 0.0, 0.0, float(speeds[0]), float(speeds[1])))
    return with_readings(begun, wheel, gyro, pose, seen_first=True)
