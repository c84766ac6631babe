"""Diagnose recordings of real robots made by others.

Usage: .venv/bin/python -m scripts.diagnose_real_data [--data ../shared/data] [--picture docs/pictures/real_robots.png]

Takes about five minutes, and cannot be resumed. Prints the table of docs/measurements/real_recordings.md, and draws the
picture. The diagnosis uses one part of each recording. Errors are on the other part, with the paper's model and with
the named effects, both fitted on the first part. The parts and scores are those of `scripts/score_real_data.py`.
"""

import argparse
import math
import sys
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cmr.calibration.scoring import pieces as pieces_of_path
from cmr.diagnosis.diagnose import diagnose
from cmr.diagnosis.result import Diagnosis
from cmr.estimation.free_runs import Values, free_run, stacked
from cmr.estimation.segments import segments_of
from cmr.model.motion import RobotState, drive
from cmr.model.parameters import RobotParameters
from cmr.model.velocity_controller import CONTROLLER_DEFINITIONS, NEEDED, motor_of
from cmr.parameters.file import COUNTED_WIDTH
from cmr.recordings.faults.late_wheels import with_wheels_in_time
from cmr.recordings.lags import Lag
from cmr.recordings.recording import Recording
from cmr.recordings.signal import SECONDS, Floats, hold
from scripts.score_real_data import (
    DATA,
    GRASS_PIECE,
    MAEBOT_PIECE,
    Importer,
    optiodom_runs,
    parameters_of,
    rolling,
    steps_of_grass,
    thinned,
    windows_of_tile,
)

SHORTEST = 1.0  # s between the first and last pose of a window that is used
PICTURE = Path(__file__).resolve().parents[1] / "docs" / "pictures" / "real_robots.png"


class Score(NamedTuple):
    """An error on left-out data, in `unit`, with the paper's model (`before`) and with the named effects (`after`)."""

    what: str
    unit: str
    before: float
    after: float

    @property
    def gone(self) -> float:
        """The share of the error that the effects explain."""
        return 1.0 - self.after / self.before


@dataclass(frozen=True)
class Case:
    """A diagnosed recording; `found_effects` are the named effects with their sizes, `scores` the errors."""

    recording: str
    diagnosis: Diagnosis
    found_effects: tuple[str, ...]
    scores: tuple[Score, ...]

    @property
    def names(self) -> list[str]:
        """The names of the effects."""
        return [effect.name for effect in self.diagnosis.effects]

    def value(self, name: str) -> float:
        """Return the estimate of a parameter."""
        return self.diagnosis.parameters[name]

    def line(self) -> str:
        """Return the line of the Markdown table."""
        scores = "; ".join(
            f"{s.what} {s.before:.3g} to {s.after:.3g} {s.unit} ({-100.0 * s.gone:+.0f} %)" for s in self.scores
        )
        return f"| {self.recording} | {', '.join(self.found_effects) or 'nothing'} | {scores} |"


class Ends(NamedTuple):
    """Errors of two models at the ends of n stretches: `position`, shape (n, 2 models, 2 axes) [m], and `heading`,
    shape (n, 2) [rad]. `turned`, shape (n,), is the angle by which the robot turned [rad].
    """

    position: Floats
    heading: Floats
    turned: Floats


def case_of(recording: str, diagnosis: Diagnosis, scores: Sequence[Score]) -> Case:
    """Return the case of a diagnosis."""
    found_effects = tuple(
        ", ".join(
            f"`{n}` {value.value:.3g} {unit_of(effect.name, n)}".rstrip() for n, value in effect.estimates.items()
        )
        for effect in diagnosis.effects
    )
    return Case(recording, diagnosis, found_effects, tuple(scores))


def unit_of(effect: str, parameter: str) -> str:
    """Return the unit of an effect's parameter, empty if it has none."""
    from cmr.model.catalogue import CATALOGUE

    unit = next(entry.unit for entry in CATALOGUE[effect].parameters if entry.name == parameter)
    return "" if unit == "-" else unit


def models_of(diagnosis: Diagnosis) -> tuple[Values, Values]:
    """Return the values of the paper's model and of the model with effects, with a made-up motor if there is none."""
    assert diagnosis.baseline is not None, diagnosis.sentence
    whole = dict(diagnosis.parameters)
    given = {name: whole[name] for name in ("wheel_radius", *CONTROLLER_DEFINITIONS) if name in whole}
    before = {name: estimate.value for name, estimate in diagnosis.baseline.estimates.items()}
    return in_motors(given | before), in_motors(whole)


def in_motors(values: Values) -> Values:
    """Return all values of the model, with a velocity controller converted to a motor."""
    own = {name: value for name, value in values.items() if name not in CONTROLLER_DEFINITIONS}
    if set(NEEDED) <= set(values):
        own |= {**motor_of(values), COUNTED_WIDTH: values.get("command_base_width", values["base_width"])}
    return parameters_of(own).values


def ends_of(recording: Recording, starts: Iterable[int], seconds: float, models: Sequence[Values]) -> Ends:
    """Return the errors at the last pose of each stretch, which has `seconds` and begins at one of `starts` [us].

    Each stretch starts at the measured pose; driven wheels run freely from the beginning of the recording.
    """
    position, heading, turned = [], [], []
    begins = np.array(sorted(starts))
    for piece in segments_of(recording, [], 0):
        observations = piece.observations
        times = (begins - piece.first) * SECONDS
        first = np.unique(
            np.searchsorted(observations.pose_time, times[(times > -seconds) & (times < observations.seconds)] - 1e-6)
        )
        last = (
            np.searchsorted(
                observations.pose_time, observations.pose_time[first[first < len(observations.pose)]] + seconds + 1e-6
            )
            - 1
        )
        first = first[: len(last)]
        long = observations.pose_time[last] - observations.pose_time[first] > SHORTEST
        errors = free_run(observations, first, observations.pose, stacked(models)).pose[last[long]]
        position.append(errors[:, :2].transpose(0, 2, 1))
        heading.append(errors[:, 2])
        theta = np.unwrap(observations.pose[:, 2])
        turned.append((theta[last] - theta[first])[long])
    return Ends(np.concatenate(position), np.concatenate(heading), np.concatenate(turned))


def joined(parts: Sequence[Ends]) -> Ends:
    """Return the stretches of all parts together."""
    return Ends(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def distance_score(what: str, ends: Ends) -> Score:
    """Return the score of the root mean square distance at the ends."""
    return Score(what, "m", *np.sqrt(np.mean(np.sum(ends.position**2, axis=2), axis=0)))


def heading_score(what: str, ends: Ends) -> Score:
    """Return the score of the root mean square heading error at the ends."""
    return Score(what, "degrees", *np.degrees(np.sqrt(np.mean(ends.heading**2, axis=0))))


def husky_tile(importer: Importer, every: int = 1) -> tuple[Case, Ends]:
    """Diagnose wheel speeds to pose: one of `every` windows in the first half of the commanded steps."""
    recording = importer.read("husky_tile", importer.data / "husky_tile/husky_tile.csv.gz")
    rows = importer.rows("husky_tile/husky_tile.csv.gz")
    steps = dict(zip([row["window"] for row in rows], [int(row["step"]) for row in rows], strict=True))
    known = sorted(set(steps.values()))
    first_half = [step < known[len(known) // 2] for step in steps.values()]
    rolled = [rolling(window) for window in windows_of_tile(recording)]
    fitted = [window for window, first in zip(rolled, first_half, strict=True) if first]
    diagnosis = diagnose(_only(rolling(recording), fitted[::every]))
    models = models_of(diagnosis)
    scored = [in_time(window, diagnosis) for window, first in zip(rolled, first_half, strict=True) if not first]
    ends = joined(
        [ends_of(window, [int(window.poses.utime[0])], 2.0, models) for window in scored if len(window.poses)]
    )
    return case_of("Husky, tile", diagnosis, [distance_score("position after 2 s", ends)]), ends


def in_time(recording: Recording, diagnosis: Diagnosis) -> Recording:
    """Return a recording with the timestamps of the wheels corrected by the latency that the diagnosis found."""
    late = Lag("wheels", "gyro", diagnosis.parameters.get("wheel_speed_latency", 0.0), 0.0)
    return with_wheels_in_time(recording, late)


def _only(recording: Recording, parts: Sequence[Recording]) -> Recording:
    """Return the recording restricted to the times of these parts."""
    begins, ends = (np.array([part.wheels.utime[end] for part in parts]) for end in (0, -1))
    kept = {}
    for name, signal in recording.signals.items():
        number = np.searchsorted(begins, signal.utime, side="right") - 1
        kept[name] = (number >= 0) & (signal.utime <= ends[np.maximum(number, 0)])
    return recording.where({name: mask for name, mask in kept.items() if len(mask)})


def husky_wet_grass(importer: Importer) -> Case:
    """Diagnose commands to pose: the first half of the commanded steps."""
    recording = importer.read("husky_wet_grass", importer.data / "husky_wet_grass/husky_wet_grass.csv.gz")
    driven = list(steps_of_grass(recording, importer.rows("husky_wet_grass/husky_wet_grass.csv.gz")))
    half = len(driven) // 2
    spans = [(int(step.wheels.utime[0]), int(step.wheels.utime[-1])) for step in driven]
    diagnosis = diagnose(recording.between(spans[0][0], spans[half - 1][1]))
    scored = recording.between(spans[half][0], spans[-1][1])
    starts = [int(piece.poses.utime[0]) for step in driven[half:] for piece in pieces_of_path(step, GRASS_PIECE)]
    ends = ends_of(scored, starts, GRASS_PIECE, models_of(diagnosis))
    scores = [heading_score("heading after 3 s", ends), distance_score("position after 3 s", ends)]
    return case_of("Husky, wet grass", diagnosis, scores)


def mbot(importer: Importer, rest: float = math.inf) -> Case:
    """Diagnose PWM to wheel speed: everything except the second half of the drive, which is for scoring.

    Of the robot's rest at the end, with PWM still on, the first `rest` [s] are used.
    """
    recording = importer.read("mbot", importer.data / "mbot_square/drive_square.log")
    wheels = recording.wheels
    moving = (wheels["psi_left"] != 0.0) | (wheels["psi_right"] != 0.0)
    first, last = int(wheels.utime[0]), int(wheels.utime[moving][-1])
    middle = (first + last) // 2
    resting = {n: (s.utime > last) & (s.utime - last < rest / SECONDS) for n, s in recording.signals.items() if len(s)}
    kept = {name: of_rest | (recording.signals[name].utime <= middle) for name, of_rest in resting.items()}
    diagnosis = diagnose(recording.where(kept))
    driven = recording.between(first, last)
    errors = [wheel_speed_errors(driven, values, middle) for values in models_of(diagnosis)]
    scores = [Score(f"{side} wheel", "m/s", *(of_model[side] for of_model in errors)) for side in ("left", "right")]
    return case_of("MBot", diagnosis, scores)


def wheel_speed_errors(recording: Recording, values: Values, since: int) -> dict[str, float]:
    """Return the root mean square error of each wheel's speed [m/s] after `since` [us], run freely from the start."""
    wheels, duty = recording.wheels, recording.duty
    times = np.union1d(duty.utime, wheels.utime)
    left, right = (hold(duty, side, times[:-1]) for side in ("left", "right"))
    start = RobotState(0.0, 0.0, 0.0, wheels["psi_left"][0], wheels["psi_right"][0], 0.0, 0.0)
    at = np.searchsorted(times, wheels.utime)
    run = drive(left, right, np.diff(times) * SECONDS, RobotParameters.of(dict(values)), start, at=at)
    counted, radius = wheels.utime > since, values["wheel_radius"]
    speeds = {"left": run.psi_left - wheels["psi_left"], "right": run.psi_right - wheels["psi_right"]}
    return {side: radius * float(np.sqrt(np.mean(error[counted] ** 2))) for side, error in speeds.items()}


def optiodom(importer: Importer, sessions: int | None = None) -> Case:
    """Diagnose encoders to pose: circles and squares, except the first session of each, which is for scoring.

    `sessions` limits the number of sessions of each.
    """
    runs = optiodom_runs(importer, sessions)
    left_out = [next(key for key in runs if key[0] == kind) for kind in ("circular", "square")]
    fitted = [thinned(run) for key, of_session in runs.items() if key not in left_out for run in of_session]
    diagnosis = diagnose(fitted)
    models = models_of(diagnosis)
    scores = []
    for (kind, _session), key in zip(left_out, left_out, strict=True):
        errors = np.mean([path_errors(run, models) for run in runs[key]], axis=0)
        scores.append(Score(f"path of {kind} runs", "m", *errors))
    return case_of("OptiOdom", diagnosis, scores)


def path_errors(recording: Recording, models: Sequence[Values]) -> Floats:
    """Return the root mean square distance of each model from the path, starting at its first pose [m]."""
    observations = segments_of(recording, [], 0)[0].observations
    first = np.zeros(1, np.int64)
    errors = free_run(observations, first, observations.pose, stacked(models)).pose
    return np.asarray(np.sqrt(np.mean(errors[:, 0] ** 2 + errors[:, 1] ** 2, axis=0)), np.float64)


def maebot(importer: Importer) -> Case:
    """Diagnose encoders to SLAM pose: the first half. The gyro is left out, because its timestamps do not advance."""
    recording = importer.read("maebot", importer.data / "maebot_convex/convex.log")
    recording = replace(recording, gyro=recording.gyro.between(0, 0))
    first, last = int(recording.poses.utime[0]), int(recording.poses.utime[-1])
    middle = (first + last) // 2
    diagnosis = diagnose(recording.between(first, middle))
    scored = recording.between(middle, last)
    starts = [int(piece.poses.utime[0]) for piece in pieces_of_path(scored, MAEBOT_PIECE)]
    ends = ends_of(scored, starts, MAEBOT_PIECE, models_of(diagnosis))
    return case_of("MAEBot", diagnosis, [distance_score("position after 5 s", ends)])


def draw(ends: Ends, path: Path) -> None:
    """Draw the lateral error of the Husky's tracked point over the angle turned, for both models."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(figsize=(7.0, 3.4), layout="constrained")
    for model, (label, color) in enumerate((("paper's model", "0.65"), ("with the effects named", "tab:blue"))):
        axes.plot(np.degrees(ends.turned), 100.0 * ends.position[:, model, 1], ".", ms=4, color=color, label=label)
    axes.set(xlabel="turned in 2 s [degrees]", ylabel="error to the left [cm]")
    axes.legend(frameon=False)
    axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(path, dpi=150)
    plt.close(figure)


def cases(importer: Importer, picture: Path | None) -> Iterator[Case]:
    """Yield each case when it is finished, and draw the picture if a path is given."""
    tile, ends = husky_tile(importer)
    if picture:
        draw(ends, picture)
    yield tile
    yield husky_wet_grass(importer)
    yield mbot(importer)
    yield optiodom(importer)
    yield maebot(importer)


def main() -> int:
    """Print the table, line by line; return the exit code."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--data", type=Path, default=DATA, help="folder of the recordings (default: %(default)s)")
    options.add_argument("--picture", type=Path, default=PICTURE, help="picture to write (default: %(default)s)")
    chosen = options.parse_args()
    if not chosen.data.is_dir():
        print(f"There are no recordings in {chosen.data}.", file=sys.stderr)
        return 1
    with tempfile.TemporaryDirectory() as folder:
        print("| recording | named | errors on left-out data |\n|---|---|---|", flush=True)
        for case in cases(Importer(chosen.data, Path(folder)), chosen.picture):
            print(case.line(), flush=True)
            print(f"{case.recording}: {case.diagnosis.sentence}", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
