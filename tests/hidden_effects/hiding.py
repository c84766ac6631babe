"""Make a log, or a recording, in which effects are hidden."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cmr.parameters.file import ParameterFile, Value
from cmr.recordings.recording import Recording
from tests.hidden_effects.cases import Case, Truth
from tests.hidden_effects.driving import commands_of
from tests.hidden_effects.logs import write_log
from tests.hidden_effects.places import placed
from tests.hidden_effects.robots import draw_nominal, draw_robot
from tests.hidden_effects.sizes import draw_sizes
from tests.hidden_effects.windows import is_windowed, parameters_of_windows, windowed
from tests.reference_plant import Drive, drive


@dataclass(frozen=True)
class HiddenLog:
    """An event log, and what is hidden in it."""

    path: Path
    truth: Truth


@dataclass(frozen=True)
class HiddenRecording:
    """A recording as it would be read from the log, the true motion (100 Hz), and what is hidden."""

    recording: Recording
    motion: Mapping[str, Any]
    truth: Truth


def hide(*effects: str, path: Path | str, **options: Any) -> HiddenLog:
    """Write an event log of a robot with these effects; `options` are those of Case."""
    return hide_case(Case(effects, **options), Path(path))


def hide_case(case: Case, path: Path) -> HiddenLog:
    """Write the event log of a case."""
    hidden = recorded(truth_of(case))
    return HiddenLog(write_log(path, hidden.recording), hidden.truth)


def hidden_recording(*effects: str, **options: Any) -> HiddenRecording:
    """Return the recording of a robot with these effects without writing a log; `options` are those of Case."""
    return recorded(truth_of(Case(effects, **options)))


def truth_of(case: Case) -> Truth:
    """Draw what the case hides."""
    random = case.random("robot")
    robot = draw_robot(random)
    nominal = draw_nominal(robot, random)
    parameters = {}
    for effect in case.effects:
        parameters.update(draw_sizes(effect, robot, case.seconds, random))
    if is_windowed(case):
        parameters = parameters_of_windows(case, parameters)
    return placed(Truth(case=case, robot=robot, parameters=parameters, nominal=nominal))


def recorded(truth: Truth) -> HiddenRecording:
    """Return the recording of a robot that is what `truth` says, on the drive of its case."""
    driven = _driven(truth)
    return HiddenRecording(driven.recording, driven.truth.fields, truth)


def _driven(truth: Truth) -> Drive:
    case = truth.case
    nominal = ParameterFile(0, {name: Value(value) for name, value in truth.nominal.items()})
    commands = commands_of(truth, case.drive_seed)
    driven = drive(commands, truth.plant, case.seconds, truth.noise, case.drive_seed, nominal=nominal)
    return driven._replace(recording=windowed(truth, driven.recording)) if is_windowed(case) else driven
