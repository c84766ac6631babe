"""The first drive of a robot that was brought up: the figure-eight by the files of bring-up, and its calibration."""

import dataclasses
from pathlib import Path

from cmr.calibration import CalibrationResult, calibrate
from cmr.parameters.file import load
from cmr.recordings.recording import Recording
from robot_driver.emulator.settings import load_settings
from robot_driver.simulated.bringing_up import Outcome
from robot_driver.simulated.drive import SimulatedDrive

from .bringup_robots import Case, verdict

SECONDS = 70.0  # of simulated time; the figure-eight at two speeds, and a rest
BOUNDS = {"k2_over_k3": 0.05, "k1": 0.02, "base_width": 0.012}  # shares; what messy robots are calibrated to
LONGEST = 600.0  # s from the first question to the last answer


def corrected(case: Case, outcome: Outcome, folder: Path) -> tuple[Case, Outcome]:
    """Correct at their source what bring-up said of the poses, and run its last step again where they were wrong."""
    cameras = load_settings().cameras
    if case.settings.cameras == cameras and not case.bringup.own_number:
        return case, outcome
    bringup = dataclasses.replace(
        case.bringup, settings=dataclasses.replace(case.settings, cameras=cameras), own_number=0
    )
    again = bringup.run_directly(folder, ("floor",), outcome.known)
    return dataclasses.replace(case, bringup=bringup), dataclasses.replace(
        again, seconds=outcome.seconds + again.seconds
    )


def calibrated(case: Case, outcome: Outcome, folder: Path) -> CalibrationResult:
    """Drive the figure-eight by the files in the folder, and calibrate from its log.

    Raises EstimationError where that fails.
    """
    believed, log = load(folder / "robot_0.yaml"), folder / "run.lcm"
    drive = SimulatedDrive(
        settings=case.settings,
        controller=case.bringup.controller,
        gyro=case.bringup.gyro,
        behaviour="manoeuvre",
        behaviour_settings={"name": "figure_eight"},
        seconds=SECONDS,
        believed=believed,
        wired=outcome.known.settings(0),
    )
    drive.write_log(log)
    return calibrate(Recording.read(log), believed)


def errors(case: Case, result: CalibrationResult) -> dict[str, float]:
    """Return by which share each parameter is off."""
    return {name: result.values[name] / getattr(case.settings.robot, name) - 1.0 for name in BOUNDS}


def beyond(case: Case, result: CalibrationResult) -> list[str]:
    """Return which parameters are further off than BOUNDS."""
    off = errors(case, result)
    return [f"{name} {off[name]:+.1%}" for name, share in BOUNDS.items() if abs(off[name]) > share]


def brought_up(case: Case, folder: Path, *, directly: bool, driven: bool) -> dict[str, object]:
    """Return the row of a robot, brought up without driver and bytes if `directly`, and `driven` and calibrated."""
    mounting = case.settings.mounting
    row: dict[str, object] = {"name": case.name, "controller": case.bringup.controller, "poses": "+".join(case.wrong)}
    row["dead"] = mounting.left_encoder_dead or mounting.right_encoder_dead
    rest: dict[str, object] = dict.fromkeys(("before_yes", "before_floor", "seconds", *BOUNDS), "")
    try:
        outcome = case.bringup.run_directly(folder) if directly else case.bringup.run(folder)
        result, why = verdict(case, outcome)
        rest |= {"before_yes": outcome.largest_before_yes, "before_floor": outcome.largest_before_floor}
        rest["seconds"] = f"{outcome.seconds:.0f}"
        if driven and result == "right" and not row["dead"]:
            rest |= _driven(case, outcome, folder)
    except Exception as error:  # a study of hundreds of robots goes on
        return row | {"verdict": "failed", "why": f"{type(error).__name__}: {error}"} | rest
    return row | {"verdict": result, "why": "; ".join(why)} | rest


def _driven(case: Case, outcome: Outcome, folder: Path) -> dict[str, object]:
    """Return how the first drive went: how long it took to get there (s), and by which share parameters are off."""
    case, outcome = corrected(case, outcome, folder)
    off = errors(case, calibrated(case, outcome, folder))
    return {"seconds": f"{outcome.seconds:.0f}"} | {name: f"{value:.4f}" for name, value in off.items()}
