"""Prepare virtual robots as a laboratory would: calibrate real robots, diagnose one, draw a population.

The drives are simulated; they are processed by the same code as in cmr-calibrate and cmr-diagnose.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from cmr.calibration.calibrator import Calibrator
from cmr.diagnosis.diagnose import diagnose
from cmr.diagnosis.document import extended_file
from cmr.estimation.estimates import EstimationError
from cmr.experiments.team.casting import Cast
from cmr.experiments.team.experiment import run
from cmr.experiments.team.hidden import Laboratory
from cmr.experiments.team.population import population_of
from cmr.experiments.team.real_robots import OnChannel
from cmr.model.parameters import RobotParameters
from cmr.parameters.file import ParameterFile
from cmr.recordings.recording import Recorder, Recording

EIGHT = {"size": "0.7", "speed": "0.3", "laps": "1", "start": "1.5"}
EIGHT_DURATION = 24.0  # s
RICH = {"name": "rich_drive", "space": "10"}  # m: there are no walls
RICH_DURATION = 130.0  # s
OTHERS = (1_000_001, 1_000_002)  # ids of further robots calibrated for a population


@dataclass(frozen=True)
class _Behaviour:
    name: str
    settings: Mapping[str, str]


@dataclass(frozen=True)
class _Robot:
    robot_id: int
    behaviour: _Behaviour
    start: tuple[float, float, float] = (0.0, 0.0, 0.0)
    waypoints: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True)
class _Ending:
    waypoints_reached: bool = False


@dataclass(frozen=True)
class _Drive:
    """A scenario of one robot on an unbounded empty floor."""

    robots: tuple[_Robot, ...]
    duration: float
    discs: tuple[tuple[float, float, float], ...] = ()
    walls: tuple[tuple[float, float, float, float], ...] = ()
    geofence: tuple[tuple[float, float], ...] | None = None
    process_noise: bool = False
    reaction: float = 0.0
    ends_when: _Ending = field(default_factory=_Ending)


def calibrated(laboratory: Laboratory, believed: ParameterFile, robot_id: int, seed: int) -> ParameterFile | None:
    """Return the result of cmr-calibrate on a real robot's figure-eight; None if it fails."""
    nominal = replace(believed, robot_id=robot_id)
    calibrator = Calibrator(robot_id, nominal)
    _drive(_Behaviour("figure_eight", EIGHT), EIGHT_DURATION, Cast(nominal, (robot_id,), laboratory), seed, calibrator)
    result = calibrator.fit()
    return None if result is None else result.parameter_file({"log": "cmr-fidelity"})


def diagnosed(laboratory: Laboratory, believed: ParameterFile, robot_id: int, seed: int) -> ParameterFile | None:
    """Return the parameters and effects from cmr-diagnose on a real robot's figure-eight and rich drive.

    None if the paper's model cannot be fitted.
    """
    nominal = replace(believed, robot_id=robot_id)
    cast = Cast(nominal, (robot_id,), laboratory)
    drives = ((_Behaviour("figure_eight", EIGHT), EIGHT_DURATION), (_Behaviour("manoeuvre", RICH), RICH_DURATION))
    recordings = [_recorded(*drive, cast, seed) for drive in drives]
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


def _recorded(behaviour: _Behaviour, duration: float, cast: Cast, seed: int) -> Recording:
    recorder = Recorder(cast.believed.robot_id)
    _drive(behaviour, duration, cast, seed, recorder)
    return recorder.recording()


def _drive(behaviour: _Behaviour, duration: float, cast: Cast, seed: int, hears: Calibrator | Recorder) -> None:
    """Let one real robot drive alone, and pass its messages to a listener."""
    robot_id = cast.believed.robot_id

    def listen(utime: int, message: OnChannel) -> None:
        hears.handle(utime, *message)

    run(_Drive((_Robot(robot_id, behaviour),), duration), cast, seed, listen=listen)
