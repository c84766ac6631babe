"""What to drive next: sentences for a person, from the catalogue of effects and the table of manoeuvres.

What an effect needs, and what tells two effects apart, is text in the catalogue (`Effect.needs`,
`Effect.confused_with`). Each manoeuvre lists the motions of such texts that it gives (`Manoeuvre.gives`); those
manoeuvres are recommended that give all motions of a text in the shortest time.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import chain, combinations

from cmr.diagnosis.words import regressor_name, signal_name
from cmr.manoeuvres import MANOEUVRES, TYPICAL, Manoeuvre, in_sequence
from cmr.manoeuvres.table import BETWEEN
from cmr.model.catalogue import CATALOGUE
from cmr.model.parameters import RobotParameters

HOPELESS = "none: "  # so begin the catalogue's texts where nothing tells two effects apart
REST = "rest"
FALLBACK = "rich_drive"
WITHOUT_POSES = (
    "No poses were recorded (POSE_N), so the path of the robot is unknown: record the poses of a motion-capture or "
    "localisation system in the next drive."
)
# In which manoeuvre what goes with a regressor stands out from what goes with others.
PARTING = {
    "command_left": "ramps",
    "command_right": "ramps",
    "command_change": "multisine",
    "speed": "straight_runs",
    "yaw_rate": "spins",
    "speed_times_yaw_rate": "circles",
    "acceleration": "steps",
    "yaw_acceleration": "one_sided_steps",
    "x": "star",
    "y": "star",
    "heading": "star",
    "wheel_angle_left": "ramps",
    "wheel_angle_right": "ramps",
    "energy": "repeat_loop",
}
MOTIONS = frozenset[str]().union(*(manoeuvre.gives for manoeuvre in MANOEUVRES.values()))
MOTION = re.compile(rf"\b(?:{'|'.join(sorted(MOTIONS, key=len, reverse=True))})\b")


def experiment_to_tell_apart(
    name: str, others: Sequence[str], *, robot_id: int = 0, robot: RobotParameters = TYPICAL
) -> str | None:
    """Return what to drive to find out which of these effects a robot has; None if `others` is empty.

    Where nothing can tell, it says so. Time and space are those of `robot`.
    Raises KeyError for an effect that is not in the catalogue.
    """
    texts = {other: telling_apart(name, other) for other in others}
    hopeless = {other: text.removeprefix(HOPELESS) for other, text in texts.items() if text.startswith(HOPELESS)}
    possible = {other: text for other, text in texts.items() if other not in hopeless}
    sentences = []
    if possible:
        motions = [text if motions_in(text) else _needs(name, other) for other, text in possible.items()]
        together = all(motions_in(text) for text in possible.values())
        sentences.append(f"To distinguish {_words(name)} {_from_each(possible)}.")
        sentences.append(_record(manoeuvres_giving(motions), robot_id, robot, together))
    if hopeless:
        sentences.append(
            f"No drive can distinguish {_words(name)} {_from_each(hopeless)}. The simulation is the same with either."
        )
    return " ".join(sentences) or None


def experiment_to_show(names: Sequence[str], *, robot_id: int = 0, robot: RobotParameters = TYPICAL) -> str:
    """Return what to drive so that each of these effects would show if the robot had it.

    Without names it is the drive in which any effect would show. Time and space are those of `robot`.
    Raises KeyError for an effect that is not in the catalogue.
    """
    chosen = manoeuvres_giving(CATALOGUE[name].needs for name in names)
    shown = _listed(map(_words, names)) or "any effect"
    sentence = f"{shown} would be visible in {_listed(manoeuvre.what for manoeuvre in chosen)}."
    return f"{sentence[0].upper()}{sentence[1:]} {_record(chosen, robot_id, robot)}"


def experiment_to_explain(
    signal: str, regressors: Sequence[str], *, robot_id: int = 0, robot: RobotParameters = TYPICAL
) -> str:
    """Return what to drive, and what to look at, to find out what makes the errors of a signal that no effect explains.

    `regressors` are what they go with. Time and space are those of `robot`.
    """
    what, goes_with = signal_name(signal), _listed(map(regressor_name, regressors))
    sentences = [
        f"To find the cause of the errors of the {what}, record the same drive again: errors that recur at the same "
        "time or place come from the robot, its commands or the floor, others from outside."
    ]
    chosen = [manoeuvre for manoeuvre in MANOEUVRES.values() if manoeuvre.name in {PARTING.get(r) for r in regressors}]
    if chosen:
        drive = _listed(manoeuvre.what for manoeuvre in chosen)
        parted = _listed(regressor_name(name) for name in regressors if name in PARTING)
        sentences.append(f"Errors that depend on {parted} are clearest in {drive}. {_record(chosen, robot_id, robot)}")
    sentences.append(
        f"Look at the plot of the {what} over {goes_with} in report.html: its shape is a clue to the cause."
    )
    return " ".join(sentences)


def telling_apart(name: str, other: str) -> str:
    """Return the catalogue's text on what tells two effects apart; if there is none, what both need."""
    first, second = CATALOGUE[name], CATALOGUE[other]
    return first.confused_with.get(other) or second.confused_with.get(name) or _needs(name, other)


def motions_in(text: str) -> frozenset[str]:
    """Return the motions that a text of the catalogue asks for; where several begin with one word, the longest."""
    return frozenset(MOTION.findall(text.lower()))


def manoeuvres_giving(texts: Iterable[str]) -> tuple[Manoeuvre, ...]:
    """Return the manoeuvres that give all motions of these texts in the shortest time, in the order of the table.

    Where the texts ask for no motion that a manoeuvre gives, it is the one that has something of everything.
    """
    wanted = frozenset(chain.from_iterable(map(motions_in, texts)))
    if not wanted:
        return (MANOEUVRES[FALLBACK],)
    useful = {m.name: m.duties().duration for m in MANOEUVRES.values() if m.gives & wanted}
    choices = chain.from_iterable(combinations(useful, count) for count in range(1, len(useful) + 1))
    enough = (names for names in choices if wanted <= _given(names))
    shortest = min(enough, key=lambda names: sum(useful[name] for name in names))
    return tuple(MANOEUVRES[name] for name in shortest)


def _given(names: Iterable[str]) -> frozenset[str]:
    return frozenset[str]().union(*(MANOEUVRES[name].gives for name in names))


def _record(chosen: Sequence[Manoeuvre], robot_id: int, robot: RobotParameters, together: bool = True) -> str:
    """Return the sentence with the command; `together` tells whether the log so far stays of use."""
    names = [manoeuvre.name for manoeuvre in chosen]
    if REST in names and len(names) > 1:  # at both ends, so that what changes meanwhile shows
        names = [REST, *(name for name in names if name != REST), REST]
    drive = in_sequence(BETWEEN.join(names))
    return (
        f"Record `cmr-pilot --robot {robot_id} --behaviour manoeuvre,name={drive.name}` "
        f"({drive.duties(robot).duration:.0f} s, {drive.space_for(robot):.1f} m around the start), "
        f"then diagnose {'both logs together' if together else 'the new log'}."
    )


def _needs(*names: str) -> str:
    return "; ".join(dict.fromkeys(CATALOGUE[name].needs for name in names))


def _from_each(texts: Mapping[str, str]) -> str:
    """Return "from this and that: text; from another: text"."""
    return "; ".join(
        f"from {_listed(_words(other) for other, same in texts.items() if same == text)}: {text}"
        for text in dict.fromkeys(texts.values())
    )


def _words(name: str) -> str:
    return name.replace("_", " ")


def _listed(words: Iterable[str]) -> str:
    """Return "this, that and another"."""
    *first, last = [*words] or [""]
    return f"{', '.join(first)} and {last}" if first else last
