"""Make recordings ready for the search: checked, on the observer's raster, with the paper's model fitted."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from cmr.diagnosis.baseline import guess_base_width, guess_motor, turn_rates
from cmr.diagnosis.candidates import USUAL_INTERVAL, Scene
from cmr.diagnosis.experiment import pieces_of
from cmr.diagnosis.gains import COARSE as COARSE
from cmr.diagnosis.gains import choose_gains
from cmr.diagnosis.noise import Noise
from cmr.diagnosis.prediction import Predictor, predictors
from cmr.diagnosis.study import Fit, Study
from cmr.diagnosis.thinning import share_used, thinned
from cmr.model.observer import MOTION, Gains
from cmr.parameters.file import ParameterFile
from cmr.recordings.checks import check
from cmr.recordings.findings import Finding
from cmr.recordings.recording import Recording

MOTOR = ("k2_over_k3", "k1", "base_width")
ROLLING = ("wheel_radius", "base_width")
THINNED = "The drives are longer than the diagnosis needs: one of {every} readings of each sensor is used."
TURNING = 0.05  # rad/s above which a robot turns
FASTEST = 0.98  # of the time a robot turns more slowly than its fastest turns
X, Y = MOTION.index("x"), MOTION.index("y")


@dataclass(frozen=True)
class Ready:
    """Recordings ready to be searched, with the paper's model fitted; or `refused`, a sentence that says why not.

    `start` are values of the paper's parameters, by name, that free runs speak for.
    """

    study: Study | None
    base: Fit | None
    checks: tuple[Finding, ...]
    notes: tuple[str, ...] = ()
    refused: str = ""
    start: Mapping[str, float] = field(default_factory=dict)

    @property
    def rolling(self) -> bool:
        """Whether no commands were recorded: the robot rolls as its wheels did."""
        return self.base is not None and self.base.names == ROLLING


def prepare(recordings: Sequence[Recording], nominal: ParameterFile) -> Ready:
    """Check the recordings, set aside what cannot be true, and fit the paper's model to the rest."""
    findings = [check(recording) for recording in recordings]
    checks = tuple(finding for one in findings for finding in one.all)
    cleaned = [one.cleaned(recording) for one, recording in zip(findings, recordings, strict=True)]
    pieces = [
        piece
        for number, (recording, one) in enumerate(zip(cleaned, findings, strict=True))
        for piece in pieces_of(recording, [int(split) for split in one.splits], number)
    ]
    every = share_used(pieces)
    notes = (THINNED.format(every=every),) if every > 1 else ()
    ready = predictors([thinned(piece, every) for piece in pieces])
    values = {"wheel_radius": nominal.value("wheel_radius")}
    width = guess_base_width(ready, values["wheel_radius"])
    if not pieces or width is None:
        return Ready(None, None, checks, refused="The robot never turned while its wheels and its pose were recorded.")
    values["base_width"] = width
    names = ROLLING if all(len(piece.heard.given) for piece in pieces) else MOTOR
    if names is MOTOR:
        values |= guess_motor(ready, values)
    else:
        values |= {"k2_over_k3": 1.0, "k1": 1.0}
    gains = choose_gains(ready, values)
    scene = _scene(ready, values, gains)
    study = Study(ready, gains, scene)
    base = study.fit(values, names, Noise.plain(ready, study.errors(values)), renew=0)
    study.scene = replace(scene, parameters=base.values)
    return Ready(study, base, checks, notes, start=values)


def _scene(ready: Sequence[Predictor], values: dict[str, float], gains: Gains) -> Scene:
    """Return how fast the robot turned, how far it went, and how often its pose was told."""
    motions = [predictor.errors(values, gains).motion for predictor in ready]
    rates = [np.abs(motion[:, MOTION.index("yaw_rate")]) for motion in motions]
    fast = np.concatenate([rate[rate > TURNING] for rate in rates])
    seen = np.concatenate([turn_rates(predictor) for predictor in ready])
    intervals = [np.diff(predictor.piece.heard.pose_time) for predictor in ready]
    squares = np.concatenate([motion[:, X] ** 2 + motion[:, Y] ** 2 for motion in motions])
    return Scene(
        values,
        turning=float(np.sqrt(np.mean(fast**2))) if len(fast) else 1.0,
        extent=float(np.sqrt(np.mean(squares))),
        fastest=float(np.quantile(seen, FASTEST)),
        interval=float(np.median(np.concatenate(intervals))) if any(map(len, intervals)) else USUAL_INTERVAL,
    )
