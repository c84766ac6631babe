"""Export robots, run them in the target simulator, and diagnose the recording against a parameter file."""

import csv
import json
import tempfile
import time
import traceback
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from cmr.diagnosis.diagnose import diagnose
from cmr.diagnosis.result import NO_EFFECT, Against, Diagnosis
from cmr.exporting.carried import BY_TARGET, FMU, MJCF, PYTHON, Carry, of_robot
from cmr.exporting.departures import recording_of
from cmr.exporting.export import export, name_of_file
from cmr.exporting.proof import RUN, STEP, Floats
from cmr.exporting.robot import exported
from cmr.model.catalogue import effects_on
from cmr.model.effect import Effect
from cmr.parameters.file import ParameterFile, Value
from tests.hidden_effects.cases import RICH, Case
from tests.hidden_effects.driving import commands_of
from tests.hidden_effects.hiding import truth_of
from tests.hidden_effects.sets import WITH_DUTIES

TARGETS = (MJCF, FMU, PYTHON)
SAME, PLANTED = KINDS = ("same", "planted")
MOST = 3  # effects of a robot
EQUIVALENT = (frozenset({"wheel_radius_scale", "encoder_scale"}),)  # pairs that the data cannot distinguish


@dataclass(frozen=True)
class Task:
    """A robot to export: the target, and the question.

    With SAME, the robot is the one of the parameter file. With PLANTED, it has one effect more than the file.
    """

    target: str
    kind: str
    seed: int


@dataclass(frozen=True)
class Result:
    """The diagnosis of a robot: one row of the CSV file of the study.

    `names` are the effects that depart from the file, `beside` those that cannot be distinguished from them, and
    `parameters` the other parameters that depart.
    """

    target: str
    kind: str
    seed: int
    effects: tuple[str, ...] = ()
    planted: str = ""
    verdict: str = ""
    names: tuple[str, ...] = ()
    beside: tuple[str, ...] = ()
    parameters: tuple[str, ...] = ()
    cpu_seconds: float = 0.0
    error: str = ""
    sizes: dict[str, float] = field(default_factory=dict)

    @property
    def task(self) -> Task:
        """The task with this result."""
        return Task(self.target, self.kind, self.seed)

    @property
    def right(self) -> bool:
        """Whether nothing departs from the file, or, for PLANTED, the planted effect does."""
        return self.verdict == NO_EFFECT if self.kind == SAME else self.planted in self.names


def tasks(kinds: Sequence[str], targets: Sequence[str], numbers: Iterable[int]) -> list[Task]:
    """Return tasks for robots with these numbers, for each kind and target."""
    return [Task(target, kind, seed) for seed in numbers for kind in kinds for target in targets]


def effects_of(task: Task) -> tuple[tuple[str, ...], str]:
    """Return the effects of a robot, and the planted one; all are effects that the target can represent."""
    carried = [name for name in WITH_DUTIES if task.target != MJCF or name in BY_TARGET[MJCF]]
    random = np.random.default_rng([task.seed, KINDS.index(task.kind), task.target == MJCF])
    # All effects are planted equally often.
    planted = carried[task.seed % len(carried)] if task.kind == PLANTED else ""
    others = [name for name in carried if not any({name, planted} <= pair for pair in EQUIVALENT)]
    count = int(random.integers(0, MOST)) + (task.kind == SAME)
    drawn = [name for name in random.permutation(others).tolist() if name != planted][:count]
    if any(pair <= {*drawn} for pair in EQUIVALENT):
        drawn.pop()
    return tuple([*drawn, planted] if planted else drawn), planted


def run_task(task: Task) -> Result:
    """Export, run and diagnose a robot; return the result. An error becomes part of it, so that the study goes on."""
    effects, planted = effects_of(task)
    begin = time.process_time()
    row = asdict(task) | {"effects": effects, "planted": planted}
    try:
        with tempfile.TemporaryDirectory() as folder:
            row |= _diagnose(task, effects, planted, Path(folder))
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        row["error"] = f"{type(error).__name__}: {error} ({Path(where.filename).name}:{where.lineno})"
    return Result(**row, cpu_seconds=time.process_time() - begin)


def _diagnose(task: Task, effects: tuple[str, ...], planted: str, folder: Path) -> dict[str, Any]:
    truth = truth_of(Case(effects, RICH, task.seed))
    truth = replace(truth, parameters=_as_carried(task.target, truth.robot, truth.parameters))
    own = {name for effect in effects_on(truth.parameters) if effect.name == planted for name in _parameters(effect)}
    known = {name: value for name, value in truth.parameters.items() if name not in own}
    robot = exported(_file(truth.robot, truth.parameters))
    path = folder / name_of_file(robot, task.target)
    export(robot, task.target, path)
    commands = commands_of(truth, truth.case.drive_seed)
    left, right = (zero_order_hold(commands.time, duty, truth.case.seconds) for duty in (commands.left, commands.right))
    driven = RUN[task.target](robot, path, left, right)
    recording = recording_of(driven.readings, robot, left, right, truth.case.drive_seed)
    against = Against(source="robot_0.yaml", sha256="")
    return {
        **_summary(diagnose(recording, _file(truth.robot, known), against=against)),
        "sizes": dict(truth.parameters),
    }


def _as_carried(target: str, robot: Mapping[str, float], parameters: Mapping[str, float]) -> dict[str, float]:
    """Return the parameters, with the opposite sign where the target cannot represent them.

    These are delays that would make readings newer than their timestamps.
    """
    found = of_robot(target, exported(_file(robot, parameters)))
    lost = {
        name for effect in effects_on(parameters) if found[effect.name].how is Carry.NOT for name in _parameters(effect)
    }
    return {name: -value if name in lost else value for name, value in parameters.items()}


def zero_order_hold(times: Floats, duties: Floats, seconds: float) -> Floats:
    """Return the duty in each simulation step: each duty holds from its time [s] until the next."""
    steps = STEP * np.arange(round(seconds / STEP)) + 0.5 * STEP
    return duties[np.maximum(np.searchsorted(times, steps, side="right") - 1, 0)]


def _parameters(effect: Effect) -> list[str]:
    return [parameter.name for parameter in effect.all_parameters]


def _file(robot: Mapping[str, float], parameters: Mapping[str, float]) -> ParameterFile:
    values = {name: Value(float(value)) for name, value in {**robot, **parameters}.items()}
    return ParameterFile(0, values, tuple(effect.name for effect in effects_on(parameters)))


def _summary(diagnosis: Diagnosis) -> dict[str, Any]:
    against = diagnosis.against
    return {
        "verdict": diagnosis.verdict,
        "names": tuple(effect.name for effect in diagnosis.effects),
        "beside": tuple(other for effect in diagnosis.effects for other in effect.indistinguishable_from),
        "parameters": tuple(departure.name for departure in against.departures) if against else (),
    }


def append(path: Path, rows: Iterable[Result]) -> None:
    """Append rows to a CSV file; a new file begins with a header."""
    is_new = not path.exists()
    with path.open("a", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        if is_new:
            writer.writerow([column.name for column in fields(Result)])
        for row in rows:
            writer.writerow([json.dumps(getattr(row, column.name)) for column in fields(Result)])


def read(path: Path) -> list[Result]:
    """Return the last row of each task in a CSV file; incomplete lines of interrupted runs are skipped."""
    rows: dict[Task, Result] = {}
    for row in _rows(path) if path.exists() else ():
        rows[row.task] = row
    return list(rows.values())


def _rows(path: Path) -> Iterator[Result]:
    with path.open(newline="", encoding="utf-8") as stream:
        for cells in list(csv.reader(stream))[1:]:
            try:
                values: list[Any] = [json.loads(cell) for cell in cells]
                values = [tuple(value) if isinstance(value, list) else value for value in values]
                yield Result(*values)
            except (ValueError, TypeError):
                continue


def report(rows: Sequence[Result]) -> str:
    """Return a table of the results, and a line for each robot with a wrong result.

    "Also named" counts effects and parameters that depart from the file, without the planted effect.
    """
    lines = ["| kind | target | robots | right | also named | CPU time each |", "|---|---|---|---|---|---|"]
    for kind in KINDS:
        for target in TARGETS:
            own = [row for row in rows if (row.kind, row.target) == (kind, target)]
            if own:
                right, cpu = sum(row.right for row in own), float(np.mean([row.cpu_seconds for row in own]))
                share = f"{right} ({100.0 * right / len(own):.0f} %)"
                further = sum(len({*row.names} - {row.planted}) + len(row.parameters) for row in own)
                lines.append(f"| {kind} | {target} | {len(own)} | {share} | {further} | {cpu:.1f} s |")
    lines.append("")
    for row in (row for row in rows if not row.right):
        found = row.error or f"{row.verdict} {', '.join((*row.names, *row.parameters))}".strip()
        beside = f" (or {', '.join(row.beside)})" if row.beside else ""
        planted = f", planted {row.planted}" if row.planted else ""
        lines.append(f"- {row.target} {row.kind} {row.seed} ({', '.join(row.effects)}{planted}): {found}{beside}")
    return "\n".join(lines) + "\n"
