"""Prepare virtual robots as a laboratory would: calibrate real robots, diagnose one, draw a population.

The drives are simulated; they are processed by the same code as in cmr-calibrate and cmr-diagnose.
"""

from collections.abc import Sequence
from dataclasses import replace

from cmr.calibration.calibrator import Calibrator
from cmr.diagnosis.diagnose import diagnose
from cmr.diagnosis.document import extended_file
from cmr.estimation.estimates import EstimationError
from cmr.experiments.team.experiment import run
from cmr.experiments.team.hidden import Laboratory
from cmr.experiments.team.plan import BehaviourPlan, RobotPlan, Scenario
from cmr.experiments.team.population import population_of
from cmr.experiments.team.real_robots import OnChannel
from cmr.experiments.team.roles import Roles
from cmr.geometry.places import Pose
from cmr.model.parameters import RobotParameters
from cmr.parameters.file import ParameterFile
from cmr.recordings.recording import Recorder, Recording

EIGHT = BehaviourPlan("figure_eight", {"size": "0.7", "speed": "0.3", "laps": "1", "start": "1.5"})
EIGHT_DURATION = 24.0  # s
RICH = BehaviourPlan("manoeuvre", {"name": "rich_drive", "space": "10"})  # m: there are no walls
RICH_DURATION = 130.0  # s
OTHERS = (1_000_001, 1_000_002)  # ids of further robots calibrated for a population


def calibrated(laboratory: Laboratory, believed: ParameterFile, robot_id: int, seed: int) -> ParameterFile | None:
    """Return the result of cmr-calibrate on a real robot's figure-eight; None if it fails."""
    nominal = replace(believed, robot_id=robot_id)
    calibrator = Calibrator(robot_id, nominal)
    _drive(EIGHT, EIGHT_DURATION, Roles(nominal, (robot_id,), laboratory), seed, calibrator)
    result = calibrator.fit()
    return None if result is None else result.parameter_file({"log": "cmr-fidelity"})


def diagnosed(laboratory: Laboratory, believed: ParameterFile, robot_id: int, seed: int) -> ParameterFile | None:
    """Return the parameters and effects from cmr-diagnose on a real robot's figure-eight and rich drive.

    None if the paper's model cannot be fitted.
    """
    nominal = replace(believed, robot_id=robot_id)
    roles = Roles(nominal, (robot_id,), laboratory)
    drives = ((EIGHT, EIGHT_DURATION), (RICH, RICH_DURATION))
    recordings = [_recorded(*drive, roles, seed) for drive in drives]
    try:
        return extended_file(diagnose(recordings, nominal), {"log": "cmr-fidelity"})
    except EstimationError:
        return None


def moved_by(files: Sequence[ParameterFile | None], virtual: Sequence[int], seed: int) -> dict[int, RobotParameters]:
    """Return the parameters of virtual robots, given the files of prepared robots.

    With one file all robots are equal; with several they are drawn. Failed preparations (None) are ignored; an empty
    result means the believed parameters.
    """
    known = [file for file in files if file is not None]
    if len(files) == 1 and known:
        return dict.fromkeys(virtual, known[0].robot_parameters)
    drawn_from = population_of(known) if known else None
    return {robot_id: drawn_from.draw(seed, robot_id) for robot_id in virtual} if drawn_from else {}


def _recorded(behaviour: BehaviourPlan, duration: float, roles: Roles, seed: int) -> Recording:
    recorder = Recorder(roles.believed.robot_id)
    _drive(behaviour, duration, roles, seed, recorder)
    return recorder.recording()


def _drive(behaviour: BehaviourPlan, duration: float, roles: Roles, seed: int, hears: Calibrator | Recorder) -> None:
    """Let one real robot drive alone on an unbounded empty floor, and pass its messages to a listener."""
    robot_id = roles.believed.robot_id

    def listen(utime: int, message: OnChannel) -> None:
        hears.handle(utime, *message)

    robot = RobotPlan(robot_id, "real", behaviour, start=Pose(0.0, 0.0))
    run(Scenario("drive", duration, (robot,)), roles, seed, listen=listen)
