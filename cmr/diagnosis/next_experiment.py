"""Recommend the next drive, from the catalogue of effects and the table of manoeuvres.

What an effect needs, and what distinguishes two effects, is text in the catalogue (`Effect.needs`,
`Effect.confused_with`). Each manoeuvre lists the motions in such texts that it provides (`Manoeuvre.gives`); the
shortest set of manoeuvres that provides all motions of a text is recommended. Sentences name at most MOST_NAMED
effects. The wording depends on who drives the robot: a command for `cmr-pilot`, a description for everybody else.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, combinations, zip_longest
from typing import Protocol

from cmr.diagnosis.words import MOST_NAMED, regressor_name, signal_name
from cmr.geometry.manoeuvres import MANOEUVRES, TYPICAL, Manoeuvre, in_sequence
from cmr.geometry.manoeuvres.in_words import Pace, instruction
from cmr.geometry.manoeuvres.table import BETWEEN
from cmr.model.catalogue import CATALOGUE
from cmr.model.effect import GROUPS, LAWS
from cmr.model.parameters import RobotParameters

HOPELESS = "none: "  # start of the catalogue's texts if nothing distinguishes two effects
REST = "rest"
FALLBACK = "rich_drive"
SHORT = "short_drive"  # shows nearly all that FALLBACK shows, in less than half of its time; no person can follow it
WITHOUT_POSES = (
    "No poses were recorded (POSE_N), so the path of the robot is unknown: record the poses of a motion-capture or "
    "localisation system in the next drive."
)
# The manoeuvre in which the influence of a regressor is clearest.
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
LONG = 120.0  # s; longer drives are given in minutes
WITHOUT_COMMANDS = "Record the commands that the robot gets, too: without them {causes} cannot be seen."
MOTIONS = frozenset[str]().union(*(manoeuvre.gives for manoeuvre in MANOEUVRES.values()))
MOTION = re.compile(rf"\b(?:{'|'.join(sorted(MOTIONS, key=len, reverse=True))})\b")


class Driver(Protocol):
    """Who drives the robot, which determines how to describe a drive."""

    def drives(self, chosen: tuple[Manoeuvre, ...]) -> tuple[Manoeuvre, ...]:
        """Return what is to be driven to show many effects, for which these manoeuvres were chosen."""

    def advice(self, chosen: Sequence[Manoeuvre], together: bool) -> str:
        """Return what to drive and what to do with the log; `together` says whether the current log is still useful."""


@dataclass(frozen=True)
class Pilot:
    """`cmr-pilot` drives the robot, so a drive is a command. Time and space are those of `robot`."""

    robot_id: int = 0
    robot: RobotParameters = TYPICAL

    def drives(self, chosen: tuple[Manoeuvre, ...]) -> tuple[Manoeuvre, ...]:
        """Return SHORT instead of the manoeuvre that has something of everything."""
        return (MANOEUVRES[SHORT],) if chosen == (MANOEUVRES[FALLBACK],) else chosen

    def advice(self, chosen: Sequence[Manoeuvre], together: bool) -> str:
        """Return the sentence with the command."""
        drive = in_sequence(BETWEEN.join(_with_rests(chosen)))
        return (
            f"Record `cmr-pilot --robot {self.robot_id} --behaviour manoeuvre,name={drive.name}` "
            f"({drive.duties(self.robot).duration:.0f} s, {drive.space_for(self.robot):.1f} m around the start), "
            f"then diagnose {'both logs together' if together else 'the new log'}."
        )


@dataclass(frozen=True)
class AnyDriver:
    """A person or other software drives the robot, so a drive is described in words, for this pace."""

    pace: Pace

    def drives(self, chosen: tuple[Manoeuvre, ...]) -> tuple[Manoeuvre, ...]:
        """Return the manoeuvres as they are."""
        return chosen

    def advice(self, chosen: Sequence[Manoeuvre], together: bool) -> str:
        """Return the drive in words, with the time and the space that it takes."""
        parts = [instruction(name, self.pace) for name in _with_rests(chosen)]
        space = max(part.reach for part in parts) + self.pace.width
        time = _duration(sum(part.seconds for part in parts))
        last = "diagnose it together with these recordings" if together else "diagnose the new recording"
        return (
            f"{' '.join(part.text for part in parts)} This takes about {time} and {space:.1f} m of free floor around "
            f"the start. Record it like these drives, then {last}."
        )


def _with_rests(chosen: Sequence[Manoeuvre]) -> list[str]:
    """Return the names of manoeuvres in order, with a rest at both ends to reveal changes in between."""
    names = [manoeuvre.name for manoeuvre in chosen]
    if REST in names and len(names) > 1:
        return [REST, *(name for name in names if name != REST), REST]
    return names


def _duration(seconds: float) -> str:
    return f"{max(10.0 * round(seconds / 10.0), 10.0):.0f} s" if seconds <= LONG else f"{seconds / 60.0:.0f} minutes"


def experiment_to_tell_apart(name: str, others: Sequence[str], driver: Driver = Pilot()) -> str | None:
    """Return what to drive to distinguish these effects; None if `others` is empty.

    Only the first MOST_NAMED of the others are used. If nothing can distinguish them, the text says so. Raises KeyError
    for an effect that is not in the catalogue.
    """
    texts = {other: telling_apart(name, other) for other in others[:MOST_NAMED]}
    hopeless = {other: text.removeprefix(HOPELESS) for other, text in texts.items() if text.startswith(HOPELESS)}
    possible = {other: text for other, text in texts.items() if other not in hopeless}
    sentences = []
    if possible:
        motions = [text if motions_in(text) else _needs(name, other) for other, text in possible.items()]
        together = all(motions_in(text) for text in possible.values())
        sentences.append(f"To distinguish {_words(name)} {_from_each(possible)}.")
        sentences.append(driver.advice(manoeuvres_giving(motions), together))
    if hopeless:
        sentences.append(
            f"No drive can distinguish {_words(name)} {_from_each(hopeless)}. The simulation is the same with either."
        )
    return " ".join(sentences) or None


def experiment_to_show(names: Sequence[str], driver: Driver = Pilot()) -> str:
    """Return what to drive to reveal most of these effects if the robot has them, and some of their names.

    Without names, any effect would become visible. Raises KeyError for an effect that is not in the catalogue.
    """
    chosen, shown = drive_showing(names)
    chosen = driver.drives(chosen)
    sentence = f"{causes(shown) or 'any effect'} would be visible in {_listed(one.what for one in chosen)}."
    return f"{sentence[0].upper()}{sentence[1:]} {driver.advice(chosen, together=True)}"


def drive_showing(names: Sequence[str]) -> tuple[tuple[Manoeuvre, ...], tuple[str, ...]]:
    """Return the manoeuvres that reveal most of these effects, and the effects that they reveal.

    It is a single manoeuvre, or those that reveal one of the effects; of equal ones, the shortest. Without names it is
    the manoeuvre with all kinds of motion.
    """
    if not names:
        return (MANOEUVRES[FALLBACK],), ()
    needs = {name: motions_in(CATALOGUE[name].needs) for name in names}
    choices: dict[tuple[str, ...], tuple[Manoeuvre, ...]] = {(one.name,): (one,) for one in MANOEUVRES.values()}
    for name in names:
        chosen = manoeuvres_giving([CATALOGUE[name].needs])
        choices[tuple(one.name for one in chosen)] = chosen
    shown = {key: tuple(name for name in names if needs[name] <= _given(key)) for key in choices}
    best = max(choices, key=lambda key: (len(shown[key]), -sum(MANOEUVRES[name].duties().duration for name in key)))
    return choices[best], shown[best]


def causes(names: Sequence[str]) -> str:
    """Describe effects in words, at most MOST_NAMED, one of each catalogue group first; empty without any."""
    by_group = [[name for name in names if CATALOGUE[name].group == group] for group in (*GROUPS, LAWS)]
    in_turn = [name for row in zip_longest(*by_group) for name in row if name]
    first, more = in_turn[:MOST_NAMED], len(in_turn) - MOST_NAMED
    others = [f"{more} other {'effect' if more == 1 else 'effects'}"] if more > 0 else []
    return _listed([*map(_words, first), *others]) if first else ""


def experiment_to_explain(signal: str, regressors: Sequence[str], driver: Driver = Pilot()) -> str:
    """Return what to drive, and what to check, to find the cause of errors of a signal that no effect explains.

    `regressors` are what the errors depend on.
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
        sentences.append(
            f"Errors that depend on {parted} are clearest in {drive}. {driver.advice(chosen, together=True)}"
        )
    sentences.append(
        f"Look at the plot of the {what} over {goes_with} in report.html: its shape is a clue to the cause."
    )
    return " ".join(sentences)


def telling_apart(name: str, other: str) -> str:
    """Return the catalogue's text on what distinguishes two effects; otherwise what both need."""
    first, second = CATALOGUE[name], CATALOGUE[other]
    return first.confused_with.get(other) or second.confused_with.get(name) or _needs(name, other)


def showable(names: Iterable[str], named: Sequence[str]) -> list[str]:
    """Return those of some effects that a drive may reveal beside the `named` ones, without mathematically equivalent
    ones.
    """
    return [name for name in names if not any(telling_apart(name, other).startswith(HOPELESS) for other in named)]


def without_commands(names: Sequence[str]) -> str:
    """Return the advice to record commands, so that these effects become visible."""
    return WITHOUT_COMMANDS.format(causes=causes(names))


def motions_in(text: str) -> frozenset[str]:
    """Return the motions that a text of the catalogue asks for; of those with a common beginning, the longest."""
    return frozenset(MOTION.findall(text.lower()))


def manoeuvres_giving(texts: Iterable[str]) -> tuple[Manoeuvre, ...]:
    """Return the shortest set of manoeuvres that provides all motions in these texts, in the order of the table.

    If the texts contain no such motion, it is the manoeuvre with all kinds of motion.
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
