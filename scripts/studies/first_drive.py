"""Drive a figure-eight with the settings that bring-up wrote, and calibrate the robot from it."""

import dataclasses
from pathlib import Path

from cmr.calibration import CalibrationResult, calibrate
from cmr.parameters.file import load
from cmr.recordings.recording import Recording
from robot_driver.emulator.settings import load_settings
from robot_driver.simulated.bringing_up import Outcome
from robot_driver.simulated.drive import SimulatedDrive

from .bringup_robots import Case, verdict

SECONDS = 70.0  # of simulated time: the figure-eight at two speeds, and a rest
BOUNDS = {"k2_over_k3": 0.05, "k1": 0.02, "base_width": 0.012}  # relative errors, as reached in scripts/study_messy
LONGEST = 600.0  # s of bring-up, from the first question to the last answer


def correct_poses(case: Case, outcome: Outcome, folder: Path) -> tuple[Case, Outcome]:
    """Correct faults of the poses at their source, and repeat the last step of bring-up if there were any."""
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


def drive_and_calibrate(case: Case, outcome: Outcome, folder: Path) -> CalibrationResult:
    """Drive the figure-eight with the files in the folder, and calibrate from its log.

    Raises EstimationError if the calibration fails.
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
    """Return the relative error of each parameter."""
    return {name: result.values[name] / getattr(case.settings.robot, name) - 1.0 for name in BOUNDS}


def out_of_bounds(case: Case, result: CalibrationResult) -> list[str]:
    """Return the parameters whose relative errors exceed BOUNDS."""
    off = errors(case, result)
    return [f"{name} {off[name]:+.1%}" for name, share in BOUNDS.items() if abs(off[name]) > share]


def bring_up(case: Case, folder: Path, *, directly: bool, driven: bool) -> dict[str, object]:
    """Bring up a robot and return its row of the study.

    With `directly`, the driver and its serial line are left out. With `driven`, the robot is calibrated as well.
    """
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


def _driven(case: Case, outcome: Outcome, folder: Path) -> dict[str, str]:
    """Calibrate a robot; return the duration of bring-up [s] and the relative errors of the parameters."""
    case, outcome = correct_poses(case, outcome, folder)
    off = errors(case, drive_and_calibrate(case, outcome, folder))
    return {"seconds": f"{outcome.seconds:.0f}"} | {name: f"{value:.4f}" for name, value in off.items()}
