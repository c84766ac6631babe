"""Robots that are exported, run where they were exported to, and diagnosed against parameter files."""

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
ONE_OF = (frozenset({"wheel_radius_scale", "encoder_scale"}),)  # either name says the same of the data


@dataclass(frozen=True)
class Task:
    """A robot that is exported: where to, and what is asked.

    SAME is the robot of the file; in PLANTED it has one more effect than the file that it is diagnosed against.
    """

    target: str
    kind: str
    seed: int


@dataclass(frozen=True)
class Found:
    """What a diagnosis made of a robot: one row of the study, kept as CSV. `names` are the effects that departed.

    `beside` are those that could not be distinguished from them, `parameters` others that departed.
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
        """What this is the row of."""
        return Task(self.target, self.kind, self.seed)

    @property
    def right(self) -> bool:
        """Whether nothing departs from the file, or the effect that was planted does."""
        return self.verdict == NO_EFFECT if self.kind == SAME else self.planted in self.names


def tasks(kinds: Sequence[str], targets: Sequence[str], numbers: Iterable[int]) -> list[Task]:
    """Return the robots with these numbers of each kind for each target, in turn."""
    return [Task(target, kind, seed) for seed in numbers for kind in kinds for target in targets]


def effects_of(task: Task) -> tuple[tuple[str, ...], str]:
    """Return the effects that a robot has, and which of them is planted; those that the target carries."""
    carried = [name for name in WITH_DUTIES if task.target != MJCF or name in BY_TARGET[MJCF]]
    random = np.random.default_rng([task.seed, KINDS.index(task.kind), task.target == MJCF])
    # Each effect is planted as often as any other.
    planted = carried[task.seed % len(carried)] if task.kind == PLANTED else ""
    others = [name for name in carried if not any({name, planted} <= pair for pair in ONE_OF)]
    count = int(random.integers(0, MOST)) + (task.kind == SAME)
    drawn = [name for name in random.permutation(others).tolist() if name != planted][:count]
    if any(pair <= {*drawn} for pair in ONE_OF):
        drawn.pop()
    return tuple([*drawn, planted] if planted else drawn), planted


def studied(task: Task) -> Found:
    """Return what a diagnosis makes of a robot, or the error that came instead: a study of hundreds goes on."""
    effects, planted = effects_of(task)
    begin = time.process_time()
    row = asdict(task) | {"effects": effects, "planted": planted}
    try:
        with tempfile.TemporaryDirectory() as folder:
            row |= _found(task, effects, planted, Path(folder))
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        row["error"] = f"{type(error).__name__}: {error} ({Path(where.filename).name}:{where.lineno})"
    return Found(**row, cpu_seconds=time.process_time() - begin)


def _found(task: Task, effects: tuple[str, ...], planted: str, folder: Path) -> dict[str, Any]:
    truth = truth_of(Case(effects, RICH, task.seed))
    truth = replace(truth, parameters=_as_carried(task.target, truth.robot, truth.parameters))
    own = {name for effect in effects_on(truth.parameters) if effect.name == planted for name in _parameters(effect)}
    known = {name: value for name, value in truth.parameters.items() if name not in own}
    robot = exported(_file(truth.robot, truth.parameters))
    path = folder / name_of_file(robot, task.target)
    export(robot, task.target, path)
    commands = commands_of(truth, truth.case.drive_seed)
    left, right = (held(commands.time, duty, truth.case.seconds) for duty in (commands.left, commands.right))
    driven = RUN[task.target](robot, path, left, right)
    recording = recording_of(driven.readings, robot, left, right, truth.case.drive_seed)
    against = Against(source="robot_0.yaml", sha256="")
    return {**_said(diagnose(recording, _file(truth.robot, known), against=against)), "sizes": dict(truth.parameters)}


def _as_carried(target: str, robot: Mapping[str, float], parameters: Mapping[str, float]) -> dict[str, float]:
    """Return parameters with the other sign for what the target does not carry: readings younger than their stamps."""
    found = of_robot(target, exported(_file(robot, parameters)))
    lost = {
        name for effect in effects_on(parameters) if found[effect.name].how is Carry.NOT for name in _parameters(effect)
    }
    return {name: -value if name in lost else value for name, value in parameters.items()}


def held(times: Floats, duties: Floats, seconds: float) -> Floats:
    """Return the duty that is in force in each step of a drive: each holds from its time [s] until the next."""
    steps = STEP * np.arange(round(seconds / STEP)) + 0.5 * STEP
    return duties[np.maximum(np.searchsorted(times, steps, side="right") - 1, 0)]


def _parameters(effect: Effect) -> list[str]:
    return [parameter.name for parameter in effect.all_parameters]


def _file(robot: Mapping[str, float], parameters: Mapping[str, float]) -> ParameterFile:
    values = {name: Value(float(value)) for name, value in {**robot, **parameters}.items()}
    return ParameterFile(0, values, tuple(effect.name for effect in effects_on(parameters)))


def _said(diagnosis: Diagnosis) -> dict[str, Any]:
    against = diagnosis.against
    return {
        "verdict": diagnosis.verdict,
        "names": tuple(effect.name for effect in diagnosis.effects),
        "beside": tuple(other for effect in diagnosis.effects for other in effect.indistinguishable_from),
        "parameters": tuple(one.name for one in against.departures) if against else (),
    }


def append(path: Path, rows: Iterable[Found]) -> None:
    """Append rows to a CSV file; a new one gets a heading first."""
    is_new = not path.exists()
    with path.open("a", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        if is_new:
            writer.writerow([part.name for part in fields(Found)])
        for row in rows:
            writer.writerow([json.dumps(getattr(row, part.name)) for part in fields(Found)])


def read(path: Path) -> list[Found]:
    """Return the rows of a CSV file, the last of each task; a line torn by the end of a process is passed over."""
    rows: dict[Task, Found] = {}
    for row in _rows(path) if path.exists() else ():
        rows[row.task] = row
    return list(rows.values())


def _rows(path: Path) -> Iterator[Found]:
    with path.open(newline="", encoding="utf-8") as stream:
        for cells in list(csv.reader(stream))[1:]:
            try:
                values: list[Any] = [json.loads(cell) for cell in cells]
                values = [tuple(one) if isinstance(one, list) else one for one in values]
                yield Found(*values)
            except (ValueError, TypeError):
                continue


def report(rows: Sequence[Found]) -> str:
    """Return a table of what was found, and each robot for which it is not right.

    "Also named" counts effects and parameters that depart from the file beside what was planted.
    """
    lines = ["| asked | target | robots | right | also named | time of a core each |", "|---|---|---|---|---|---|"]
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
