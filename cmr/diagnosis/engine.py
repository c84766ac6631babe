"""Make recordings ready for the search: checked, on the observer's raster, with the paper's model fitted."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cmr.diagnosis.baseline import guess_base_width, guess_motor
from cmr.diagnosis.candidates import Scene
from cmr.diagnosis.experiment import pieces_of
from cmr.diagnosis.noise import Noise
from cmr.diagnosis.prediction import Predictor, predictors
from cmr.diagnosis.study import Fit, Study
from cmr.model.observer import MOTION, Gains
from cmr.parameters.file import ParameterFile
from cmr.recordings.checks import check
from cmr.recordings.findings import Finding
from cmr.recordings.recording import Recording

MOTOR = ("k2_over_k3", "k1", "base_width")
ROLLING = ("wheel_radius", "base_width")
USUAL = Gains(0.2, 1.0, 0.15, 0.15)
OF_COARSE_ENCODERS = Gains(0.05, 0.05, 0.15, 0.15)  # whose ticks say little of the speed
COARSE = 2.0 * np.pi / 100.0  # rad; ticks that are larger are coarse
TURNING = 0.05  # rad/s above which a robot turns


@dataclass(frozen=True)
class Ready:
    """Recordings ready to be searched, with the paper's model fitted; or `refused`, a sentence that says why not."""

    study: Study | None
    base: Fit | None
    checks: tuple[Finding, ...]
    notes: tuple[str, ...] = ()
    refused: str = ""


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
    ready = predictors(pieces)
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
    scene = _scene(ready, values)
    coarse = max(piece.tick for piece in pieces) > COARSE
    study = Study(ready, OF_COARSE_ENCODERS if coarse else USUAL, scene)
    base = study.fit(values, names, Noise.plain(ready, study.errors(values)), renew=0)
    study.scene = replace(scene, parameters=base.values)
    return Ready(study, base, checks, tuple(f.sentence for f in checks if f.found))


def _scene(ready: Sequence[Predictor], values: dict[str, float]) -> Scene:
    """Return how the robot turned."""
    turning = []
    for predictor in ready:
        motion = predictor.errors(values, USUAL).motion
        rate = np.abs(motion[:, MOTION.index("yaw_rate")])
        turning.append(rate[rate > TURNING])
    fast = np.concatenate(turning)
    return Scene(values, float(np.sqrt(np.mean(fast**2))) if len(fast) else 1.0)
