"""What a diagnosis answered about laws beside what was hidden: one row of a study, a line of JSON."""

import json
import time
import traceback
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from cmr.diagnosis.diagnose import diagnose
from cmr.diagnosis.document import document
from cmr.model.catalogue import CATALOGUE
from cmr.model.laws.grammar import parse
from cmr.recordings.signal import Floats
from tests.hidden_effects.cases import Truth
from tests.hidden_effects.hiding import HiddenRecording
from tests.hidden_effects.laws.kinds import KINDS, TrueLaw
from tests.hidden_effects.laws.robots import LawCase, pair_of
from tests.hidden_effects.laws.states import States

LAW, APPROXIMATION, TIE, NO_LAW = "law", "approximation", "tie", "no law"
SAME_PLACE = {"wheel_voltage": "wheel_acceleration"}  # up to a factor, K2/K3
SIDES = {"both": (1.0, 1.0), "opposite": (1.0, -1.0), "left": (1.0, 0.0), "right": (0.0, 1.0)}
MOVING = 0.02  # rad/s; of a robot whose wheels turn more slowly formulas are not compared
RATE = 0.01  # s between true states
DEEPEST = 3  # calls of which an error says where they are
Found = Mapping[str, Any]  # an entry of `found` in diagnosis.json


@dataclass(frozen=True, kw_only=True)
class LawRow:
    """One robot: the case, and what was answered.

    `names` are the effects named, `unexplained` says whether something is called unexplained. `answer` is that on laws,
    `found` and `rivals` are laws in words. `fits` says for each true law how much of it the laws found explain (0 to 1)
    and `fits_of_set` how much the best of all laws in the answer does, over the states of the training drive.
    `places_right` says whether each law found acts where a true one does. `gain` is the ratio of the baseline's path
    error on the held-out drive to that of the answer. `error` is what went wrong, empty if nothing did.
    """

    set_name: str
    hidden: str
    seed: int
    manoeuvre: str = ""
    noise: str = ""
    removed: str = ""
    verdict: str = ""
    names: tuple[str, ...] = ()
    unexplained: bool = False
    answer: str = NO_LAW
    found: tuple[str, ...] = ()
    rivals: tuple[str, ...] = ()
    fits: tuple[float, ...] = ()
    fits_of_set: tuple[float, ...] = ()
    places_right: bool = True
    gain: float = float("nan")
    cpu_seconds: float = float("nan")
    error: str = ""
    reasons: tuple[str, ...] = field(default=())

    @property
    def key(self) -> tuple[str, str, int]:
        """What tells it from all others."""
        return self.set_name, self.hidden, self.seed


def row_of(law_case: LawCase) -> LawRow:
    """Return what a diagnosis makes of the robot of a case, or the error that came instead."""
    case, (set_name, hidden, seed) = law_case.case, law_case.key
    said: dict[str, Any] = {"manoeuvre": case.manoeuvre, "noise": case.noise, "removed": law_case.removed}
    try:
        pair = pair_of(law_case)
        begin = time.process_time()
        with without_entry(law_case.removed):
            answer = document(diagnose(pair.training, held_out=[pair.held_out]))
        said |= {"cpu_seconds": time.process_time() - begin, **answered(answer)}
        if pair.truth is not None and pair.learned is not None:
            said |= judged(answer.get("laws") or {}, pair.truth, pair.learned)
    except Exception as error:  # a study of hundreds of robots goes on
        where = traceback.extract_tb(error.__traceback__)[-DEEPEST:]
        frames = ", ".join(f"{Path(frame.filename).name}:{frame.lineno}" for frame in where)
        said["error"] = f"{type(error).__name__}: {error} ({frames})"
    return LawRow(set_name=set_name, hidden=hidden, seed=seed, **said)


@contextmanager
def without_entry(name: str) -> Iterator[None]:
    """Have the catalogue without this entry; an empty name changes nothing. The model keeps its equations."""
    before = dict(CATALOGUE)
    CATALOGUE.pop(name, None)
    try:
        yield
    finally:
        CATALOGUE.clear()
        CATALOGUE.update(before)


def answered(answer: Mapping[str, Any]) -> dict[str, Any]:
    """Return what `diagnosis.json` says, as fields of a row."""
    laws, gain = answer.get("laws") or {}, answer.get("gain") or {}
    ratio = gain.get("held_out_path_rmse_ratio")
    return {
        "verdict": answer["verdict"],
        "names": tuple(effect["name"] for effect in answer["effects"]),
        "unexplained": bool(answer["unexplained"]["present"]),
        "answer": laws.get("answer", NO_LAW),
        "found": tuple(_in_words(law) for law in laws.get("found", ())),
        "rivals": tuple(_in_words(law) for law in laws.get("indistinguishable_from", ())),
        "reasons": tuple(str(reason) for reason in laws.get("reasons", ())),
        "gain": float("nan") if ratio is None else float(ratio),
    }


def judged(laws: Mapping[str, Any], truth: Truth, learned: HiddenRecording) -> dict[str, Any]:
    """Return how far the laws of an answer are those that are true."""
    true = [law for name in truth.case.effects if name in KINDS for law in KINDS[name].laws]
    found, rivals = (list(laws.get(part, ())) for part in ("found", "indistinguishable_from"))
    if not found and not rivals:
        return {"fits": tuple(0.0 for _ in true), "fits_of_set": tuple(0.0 for _ in true)}
    states = states_of(truth, learned)
    rivals = [law for law in rivals if isinstance(law, Mapping)]  # names of effects may stand there too
    each = [[found] + [[law] for law in (*found, *rivals)]] * len(true)
    fits = [[explained(law, some, states, truth) for some in sets] for law, sets in zip(true, each, strict=True)]
    places = {place_of(law.place) for law in true}
    return {
        "fits": tuple(own[0] if found else 0.0 for own in fits),
        "fits_of_set": tuple(max(own) for own in fits),
        "places_right": all(place_of(law["place"]) in places for law in found),
    }


def states_of(truth: Truth, learned: HiddenRecording) -> States:
    """Return the true states of a drive as formulas read them."""
    time = RATE * np.arange(len(learned.motion["psi_left"]))
    commands = learned.recording.commands
    sent = (commands.utime - learned.recording.wheels.utime[0]) / 1e6
    newest = np.searchsorted(sent, time + 1e-6, side="right") - 1
    duties = np.column_stack([np.append(commands[side], 0.0)[newest] for side in ("left", "right")])
    return States(learned.motion, duties, truth.robot, RATE)


def place_of(name: str) -> str:
    """Return the place, one name for those that are the same up to a factor."""
    return SAME_PLACE.get(name, name)


def explained(law: TrueLaw, found: list[Found], states: States, truth: Truth) -> float:
    """Return the share of a true law that these laws explain, beyond what the paper's parameters do: 0 to 1.

    Coefficients are free, so a formula that says the same in other words explains all.
    """
    here = [one for one in found if place_of(one["place"]) == place_of(law.place)]
    moving = np.abs(states.psi).max(axis=1) > MOVING
    true = _flat(law.column(states, truth.parameters), moving, law.side)
    beside = [_flat(column, moving, side) for column, side in _beside(law.place, states)]
    columns = [column for one in here for column in columns_of(one, states, moving)]
    if not columns:
        return 0.0
    own = _left(true, beside)
    rest = _left(true, [*beside, *columns])
    return float(1.0 - np.sum(rest**2) / max(np.sum(own**2), 1e-300))


def columns_of(law: Found, states: States, moving: Floats) -> list[Floats]:
    """Return the values of a found law's formulas, its constants as they were estimated."""
    prefix = f"{law['name']}_"
    values = {
        key.removeprefix(prefix): one["value"] for key, one in law["parameters"].items() if key.startswith(prefix)
    }
    constants = {name: float(value) for name, value in values.items() if not name.isdigit()}
    variables = {**states.variables(), **constants}
    side = law.get("side") or ""
    share = np.array(SIDES[side]) if side else np.ones(1)
    return [_flat(parse(text, tuple(constants)).evaluate(variables) * share, moving, side) for text in law["formulas"]]


def _beside(place: str, states: States) -> list[tuple[Floats, str]]:
    """Return what the paper's parameters, and errors that are constant, already say at a place."""
    ones = np.ones_like(states.v)
    if place_of(place) == "wheel_acceleration":
        return [(states.u, "both"), (states.psi, "both")]
    if place == "wheel_slip":
        return [(states.psi, "both")]
    return [(states.w, "")] if place == "yaw_rate" else [(ones, "")] if place in ("gyro", "pose_theta") else []


def _flat(column: Floats, moving: Floats, side: str) -> Floats:
    width = 2 if side else 1
    return np.broadcast_to(column, (len(moving), width))[moving.astype(bool)].ravel()


def _left(column: Floats, others: list[Floats]) -> Floats:
    if not others:
        return column
    matrix = np.column_stack(others)
    matrix = matrix / np.maximum(np.linalg.norm(matrix, axis=0), 1e-300)
    return np.asarray(column - matrix @ np.linalg.lstsq(matrix, column, rcond=1e-10)[0])


def _in_words(law: Found | str) -> str:
    if isinstance(law, str):
        return law
    side = f" {law['side']}" if law.get("side") else ""
    return f"{law['place']}{side}: {', '.join(law['formulas'])}"


def append(path: Path, row: LawRow) -> None:
    """Append a row to a file of rows."""
    with path.open("a", encoding="utf-8") as stream:
        stream.write(json.dumps(asdict(row)) + "\n")


def read(path: Path) -> list[LawRow]:
    """Return the rows of a file, the last of each robot; a line torn by the end of a process is passed over."""
    rows: dict[tuple[str, str, int], LawRow] = {}
    lines = path.read_text(encoding="utf-8").split("\n")[:-1] if path.exists() else []
    for line in lines:
        try:
            fields = json.loads(line)
        except ValueError:
            continue
        row = LawRow(**{name: tuple(value) if isinstance(value, list) else value for name, value in fields.items()})
        rows[row.key] = row
    return list(rows.values())
