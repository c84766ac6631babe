#!/usr/bin/env python3
"""Measure the errors of the calibration on recordings of real robots made by others.

Usage: .venv/bin/python scripts/score_real_data.py [--data ../shared/data]

Takes about three minutes on two cores, and cannot be resumed. Prints the table of docs/measurements/real_recordings.md.
The recordings are imported with the code of cmr-import. Errors are on parts that were not used for fitting, unless
stated otherwise. "Nominal" are values of the robot's manufacturer or author, "-" if there are none. "Plain least
squares" is the result of an earlier fit of the same model (one gain, one lag, one base width) with soft-L1 loss on the
same parts; for OptiOdom, it is the base width that its authors found, and path errors on the fitted runs.
"""

import argparse
import csv
import gzip
import math
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import redirect_stdout
from dataclasses import dataclass, replace
from io import StringIO
from itertools import groupby
from pathlib import Path

import numpy as np

from cmr.calibration import calibrate
from cmr.calibration.motors_alone import fit_motor
from cmr.calibration.scoring import EndErrors, end_errors, path_rmse, pieces, root_mean_square, wheel_speed_errors
from cmr.estimation.commanded_speeds import as_duties, as_motor, controller_of
from cmr.model.parameters import RobotParameters
from cmr.recordings.recording import Floats, Recording
from cmr_tools.importing.import_log import main as import_log

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
DECIMALS = {"m": 4, "m/s": 3, "rad/s": 3, "degrees": 1}
MAEBOT_PIECE = 5.0  # s
FITTED_PIECE = 3.0  # s; short enough that dead reckoning does not drift
GRASS_PIECE = 3.0  # s
WINDOW_GAP = 1_000_000  # us; larger gaps separate the windows recorded on tile
POSE_STRIDE = 5  # OptiOdom: every fifth pose is used in the fits, 4 of 20 a second


@dataclass(frozen=True)
class Score:
    """One line of the table: the name and unit of an error or a parameter, and its values; None if there is none."""

    recording: str
    what: str
    unit: str
    nominal: float | None
    found: float
    median: float | None
    reference: float | None

    def line(self) -> str:
        """Return the line of the Markdown table."""
        figures = (self.nominal, self.found, self.median, self.reference)
        cells = ["-" if f is None else f"{f:.{DECIMALS[self.unit]}f}" for f in figures]
        return f"| {self.recording} | {self.what} [{self.unit}] | {' | '.join(cells)} |"


HEADER = (
    "| recording | scored [unit] | nominal | calibrated | its median | plain least squares |\n|---|---|---|---|---|---|"
)


class Importer:
    """Imports recordings in the folder `data` with cmr-import into the folder `into`, and reads them."""

    def __init__(self, data: Path, into: Path) -> None:
        self.data = data
        self._into = into

    def read(self, mapping: str, path: Path) -> Recording:
        """Return the recording at `path`, imported with a shipped mapping; duties represent commanded speeds."""
        log = self._into / f"{mapping}_{path.name.partition('.')[0]}.lcm"
        with redirect_stdout(StringIO()):
            import_log([mapping, str(path), "--out", str(log)])
        recording = Recording.read(log)
        assert recording.parameters is not None, "cmr-import writes the nominal parameters"
        return as_duties(recording, controller_of([recording], recording.parameters))

    def rows(self, path: str) -> list[dict[str, str]]:
        """Return the rows of a compressed CSV file in the data folder."""
        with gzip.open(self.data / path, "rt", encoding="utf-8", newline="") as stream:
            return list(csv.DictReader(stream))


def score_mbot(importer: Importer) -> list[Score]:
    """Score PWM to wheel speed, for each wheel: fitted on the first half of the motion, scored on the second."""
    recording = importer.read("mbot", importer.data / "mbot_square/drive_square.log")
    wheels = recording.wheels
    moving = (wheels["psi_left"] != 0.0) | (wheels["psi_right"] != 0.0)
    first, last = int(wheels.utime[0]), int(wheels.utime[moving][-1])
    middle = (first + last) // 2
    driven = recording.between(first, last)
    second_half = driven.wheels.utime[1:] > middle
    scores = []
    for side, reference in (("left", 0.097), ("right", 0.069)):
        motor = fit_motor([recording.between(first, middle)], (side,))
        found = _nominal(recording)._replace(**{name: estimate.value for name, estimate in motor.items()})
        errors = found.wheel_radius * wheel_speed_errors(driven, found, side)[second_half]
        scores.append(_score("MBot", f"PWM to {side} wheel speed", "m/s", None, errors, reference))
    return scores


def score_maebot(importer: Importer) -> list[Score]:
    """Score encoders to SLAM pose, fitted on the first half: as one drive, like cmr-calibrate, and in pieces of 3 s.

    Errors are at the ends of 5 s pieces of the second half, and along the whole run.
    """
    recording = importer.read("maebot", importer.data / "maebot_convex/convex.log")
    first, last = int(recording.poses.utime[0]), int(recording.poses.utime[-1])
    middle = (first + last) // 2
    first_half = recording.between(first, middle)
    scores = []
    for fitted_on, fitted in (("one drive", [first_half]), ("3 s pieces", pieces(first_half, FITTED_PIECE))):
        found = parameters_of(calibrate(fitted).values)
        ends = end_errors(pieces(recording.between(middle, last), MAEBOT_PIECE), found, by_wheels=True)
        whole = path_rmse(recording, found, by_wheels=True)
        what = f"encoders to pose, first half fitted as {fitted_on}"
        scores += [
            Score("MAEBot", f"{what}: whole run", "m", None, whole, None, 0.305),
            _score("MAEBot", f"{what}: end of each 5 s piece", "m", None, ends.distance, 0.0275),
        ]
    return scores


def score_optiodom(importer: Importer, sessions: int | None = None) -> list[Score]:
    """Score encoders to pose: base width and wheel diameter from all runs, and path errors of left-out sessions.

    `sessions` limits the number of sessions of each kind of path; None uses all.
    """
    runs = optiodom_runs(importer, sessions)
    fitted = {key: [thinned(run) for run in of_session] for key, of_session in runs.items()}
    together = parameters_of(calibrate([run for of_session in fitted.values() for run in of_session]).values)
    nominal = _nominal(next(iter(runs.values()))[0])
    diameter, found_diameter = 2.0 * nominal.wheel_radius, 2.0 * together.wheel_radius
    scores = [
        Score("OptiOdom", "base width, all runs", "m", nominal.base_width, together.base_width, None, 0.2009),
        Score("OptiOdom", "wheel diameter, all runs", "m", diameter, found_diameter, None, 0.0833),
    ]
    errors: dict[str, tuple[list[float], list[float]]] = {"circular": ([], []), "square": ([], [])}
    for left_out, of_session in runs.items():
        rest = [run for key, others in fitted.items() if key != left_out for run in others]
        for parameters, listed in zip(
            (nominal, parameters_of(calibrate(rest).values)), errors[left_out[0]], strict=True
        ):
            listed += [path_rmse(run, parameters, by_wheels=True) for run in of_session]
    for kind, name, reference in (("circular", "circles", 0.019), ("square", "squares", 0.032)):
        of_nominal, of_found = (np.array(listed) for listed in errors[kind])
        what = f"encoders to pose, mean path error of {len(of_found)} runs, {name}"
        mean, median = float(np.mean(of_found)), float(np.median(of_found))
        scores.append(Score("OptiOdom", what, "m", float(np.mean(of_nominal)), mean, median, reference))
    return scores


def score_husky_tile(importer: Importer, by_wheels: bool) -> list[Score]:
    """Score wheel speeds or commands to the pose after each 2 s window, fitted on the first half of the commands."""
    recording = importer.read("husky_tile", importer.data / "husky_tile/husky_tile.csv.gz")
    steps = [
        int(step)
        for (_window, step), _rows in groupby(
            importer.rows("husky_tile/husky_tile.csv.gz"), key=lambda row: (row["window"], row["step"])
        )
    ]
    windows = list(windows_of_tile(recording))
    known_steps = sorted(set(steps))
    middle = known_steps[len(known_steps) // 2]
    fitted = [window for window, step in zip(windows, steps, strict=True) if step < middle]
    scored = [window for window, step in zip(windows, steps, strict=True) if step >= middle]
    if by_wheels:
        fitted = [rolling(window) for window in fitted]
    result = calibrate(fitted, recording.parameters)
    nominal, found = (
        end_errors(scored, parameters, by_wheels=by_wheels, shortest=1.0)
        for parameters in (_nominal(recording), parameters_of(result.values))
    )
    what = "wheel speeds to pose" if by_wheels else "commands to pose"
    references = (0.110, 1.9) if by_wheels else (0.117, None)
    return _end_scores("Husky, tile", f"{what}, end of 2 s", nominal, found, references)


def score_husky_wet_grass(importer: Importer) -> list[Score]:
    """Score commands to wheel speed, and to the pose after each 3 s piece, fitted on the first half of the commands."""
    recording = importer.read("husky_wet_grass", importer.data / "husky_wet_grass/husky_wet_grass.csv.gz")
    driven = list(steps_of_grass(recording, importer.rows("husky_wet_grass/husky_wet_grass.csv.gz")))
    fitted, scored = driven[: len(driven) // 2], driven[len(driven) // 2 :]
    result = calibrate([piece for drive in fitted for piece in pieces(drive, GRASS_PIECE)], recording.parameters)
    nominal = _nominal(recording)
    motor = nominal._replace(**{name: estimate.value for name, estimate in fit_motor(fitted).items()})
    ends, found_ends = (
        end_errors([piece for drive in scored for piece in pieces(drive, GRASS_PIECE)], parameters)
        for parameters in (nominal, parameters_of(result.values))
    )
    speeds, found_speeds = (
        np.concatenate([wheel_speed_errors(drive, parameters, side) for drive in scored for side in ("left", "right")])
        for parameters in (nominal, motor)
    )
    return [
        *_end_scores("Husky, wet grass", "commands to pose, end of 3 s", ends, found_ends, (0.954, 17.2)),
        _score("Husky, wet grass", "commands to wheel speed", "rad/s", speeds, found_speeds, 0.603),
    ]


def optiodom_runs(importer: Importer, sessions: int | None) -> dict[tuple[str, str], list[Recording]]:
    """Return the runs of OptiOdom by kind of path and session; at most `sessions` of each kind."""
    runs: dict[tuple[str, str], list[Recording]] = {}
    for kind in ("circular", "square"):
        paths = sorted((importer.data / "optiodom" / kind).glob("*.csv.gz"))
        chosen = sorted({path.name.partition("_run")[0] for path in paths})[:sessions]
        for session in chosen:
            own = [path for path in paths if path.name.startswith(session)]
            runs[kind, session] = [importer.read("optiodom", path) for path in own]
    return runs


def steps_of_grass(recording: Recording, rows: list[dict[str, str]]) -> Iterator[Recording]:
    """Yield the part of each commanded step that the CSV file marks for calibration and that is long enough."""
    start = int(recording.wheels.utime[0]) - round(float(rows[0]["t_s"]) * 1e6)
    for (state, _step), of_step in groupby(rows, key=lambda row: (row["state"], row["step"])):
        seconds = [float(row["t_s"]) for row in of_step]
        if state == "calib" and seconds[-1] - seconds[0] > GRASS_PIECE:
            yield recording.between(*(start + round(t * 1e6) for t in (seconds[0], seconds[-1])))


def rolling(recording: Recording) -> Recording:
    """Return the recording without commands."""
    return replace(
        recording,
        commands=recording.commands.between(0, 0),
        wheel_speed_commands=recording.wheel_speed_commands.between(0, 0),
        velocity_commands=recording.velocity_commands.between(0, 0),
        converted_from="",
    )


def thinned(run: Recording) -> Recording:
    """Return the recording with every fifth pose."""
    return run.where({"poses": np.arange(len(run.poses)) % POSE_STRIDE == 0})


def windows_of_tile(recording: Recording) -> Iterator[Recording]:
    """Yield the windows recorded on tile, which are separated by gaps."""
    utime = recording.wheels.utime
    gaps = np.flatnonzero(np.diff(utime) > WINDOW_GAP)
    starts, ends = np.append(0, gaps + 1), np.append(gaps, len(utime) - 1)
    for first, last in zip(utime[starts], utime[ends], strict=True):
        yield recording.between(int(first), int(last))


def _nominal(recording: Recording) -> RobotParameters:
    assert recording.parameters is not None, "cmr-import writes the nominal parameters"
    nominal = as_motor(recording.parameters, controller_of([recording], recording.parameters))
    return parameters_of({name: value.value for name, value in nominal.values.items()})


def parameters_of(values: Mapping[str, float]) -> RobotParameters:
    """Return the parameters, with a made-up motor if there is none, which then does not matter."""
    return RobotParameters.of({"k2_over_k3": 1.0, "k1": 1.0} | dict(values))


def _score(
    recording: str, what: str, unit: str, nominal: Floats | None, found: Floats, reference: float | None
) -> Score:
    """Return the line for errors with nominal and found parameters: root mean squares, and the median of the latter."""
    before = None if nominal is None else root_mean_square(nominal)
    return Score(recording, what, unit, before, root_mean_square(found), float(np.median(np.abs(found))), reference)


def _end_scores(
    recording: str, what: str, nominal: EndErrors, found: EndErrors, references: tuple[float, float | None]
) -> list[Score]:
    headings = np.degrees(nominal.heading), np.degrees(found.heading)
    return [
        _score(recording, f"{what}, distance", "m", nominal.distance, found.distance, references[0]),
        _score(recording, f"{what}, heading", "degrees", *headings, references[1]),
    ]


def main() -> int:
    """Print the table, line by line; return the exit code."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--data", type=Path, default=DATA, help="folder of the recordings (default: %(default)s)")
    data = options.parse_args().data
    if not data.is_dir():
        print(f"There are no recordings in {data}.", file=sys.stderr)
        return 1
    begin = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        importer = Importer(data, Path(folder))
        print(HEADER, flush=True)
        for scores in _all_scores(importer):
            print("\n".join(score.line() for score in scores), flush=True)
    print(f"\n{math.ceil(time.monotonic() - begin)} s", file=sys.stderr)
    return 0


def _all_scores(importer: Importer) -> Iterator[list[Score]]:
    yield score_mbot(importer)
    yield score_maebot(importer)
    yield score_optiodom(importer)
    yield score_husky_tile(importer, by_wheels=True)
    yield score_husky_tile(importer, by_wheels=False)
    yield score_husky_wet_grass(importer)


if __name__ == "__main__":
    sys.exit(main())
