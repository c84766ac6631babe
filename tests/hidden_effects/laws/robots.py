"""The robots by which a search for laws is measured, set by set; `seeds` [20] says how many there are of each kind."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from cmr.recordings.recording import Recording
from tests.hidden_effects.cases import EIGHT, HELD_OUT, RICH, Case, Truth
from tests.hidden_effects.hiding import HiddenRecording, recorded, truth_of
from tests.hidden_effects.laws.kinds import KINDS
from tests.hidden_effects.messy import messy
from tests.hidden_effects.sets import NULL_NOISES, WITH_DUTIES

OF_STATE = frozenset(  # effects whose equations are formulas of the state
    {
        *("battery_sag", "battery_drift", "coulomb_friction", "quadratic_drag", "motor_gain_asymmetry"),
        *("back_emf_asymmetry", "motor_coupling", "wheel_radius_scale", "wheel_radius_asymmetry", "turn_slip"),
        *("turn_asymmetry", "travel_reduction", "longitudinal_slip", "lateral_skid", "slope", "encoder_scale"),
        *("encoder_asymmetry", "gyro_bias", "gyro_scale", "gyro_drift", "pose_heading_offset"),
        *("pose_offset", "pose_offset_lateral"),
        *("pose_distortion", "clock_skew", "motor_heating"),
    }
)
# What may be hidden beside a kind: effects that are found alone, and act elsewhere than most kinds.
BESIDE = ("motor_gain_asymmetry", "gyro_bias", "turn_slip", "wheel_radius_asymmetry", "coulomb_friction", "pose_offset")
SMALL = 0.1  # of their usual size, in the set of effects that are too small to be named
SHAPES = ("travel_reduction_saturation",)  # parameters that do not say how large an effect is
EACH = 4  # robots with one of the catalogue's effects for so many seeds is one


@dataclass(frozen=True)
class LawCase:
    """One robot of a set: what is hidden in it, and the entry that is removed from the catalogue, if any."""

    set_name: str
    case: Case
    removed: str = ""

    @property
    def key(self) -> tuple[str, str, int]:
        """What tells it from all others: set, what is hidden, and seed."""
        return self.set_name, " ".join(self.case.effects) or self.case.manoeuvre, self.case.seed


class Pair(NamedTuple):
    """What a search is given: a drive that models are fitted to, another on which they are judged; and the truth.

    `learned` and `judged` are the true motions of both with what is hidden; None for six small effects.
    """

    training: Recording
    held_out: Recording
    truth: Truth | None
    learned: HiddenRecording | None
    judged: HiddenRecording | None


def kinds(seeds: int) -> list[LawCase]:
    """Return every kind of unknown physics on the rich drive."""
    return [LawCase("kinds", Case((kind,), RICH, seed)) for seed in range(seeds) for kind in KINDS]


def null(seeds: int) -> list[LawCase]:
    """Return robots with nothing hidden: half on figure-eights, all kinds of noise in turn."""
    turns = [(drive, noise) for noise in NULL_NOISES for drive in (RICH, EIGHT)]
    drawn = [(*turns[seed % len(turns)], seed) for seed in range(50 * seeds)]
    return [LawCase("null", Case((), drive, seed, noise)) for drive, noise, seed in drawn]


def catalogue(seeds: int) -> list[LawCase]:
    """Return every effect of the catalogue on the rich drive."""
    return [LawCase("catalogue", Case((e,), RICH, seed)) for seed in range(_few(seeds)) for e in WITH_DUTIES]


def small(seeds: int) -> list[LawCase]:
    """Return every effect that is a formula of the state, so small that it is not named."""
    names = [name for name in WITH_DUTIES if name in OF_STATE]
    return [LawCase("small", Case((e,), RICH, 700 + seed)) for seed in range(_few(seeds)) for e in names]


def six(seeds: int) -> list[LawCase]:
    """Return robots with six small effects."""
    return [LawCase("six", Case((), RICH, seed)) for seed in range(5 * seeds)]


def removed(seeds: int) -> list[LawCase]:
    """Return every effect of the catalogue on the rich drive, its own entry removed."""
    return [LawCase("removed", Case((e,), RICH, seed), e) for seed in range(_few(seeds)) for e in WITH_DUTIES]


def mixed(seeds: int) -> list[LawCase]:
    """Return robots with an effect of the catalogue and a kind of unknown physics."""
    result = []
    for seed in range(5 * seeds):
        random = np.random.default_rng([seed, 25])
        pair = str(random.choice(BESIDE)), str(random.choice([name for name, kind in KINDS.items() if kind.in_grammar]))
        result.append(LawCase("mixed", Case(pair, RICH, seed)))
    return result


SETS: Mapping[str, Callable[[int], list[LawCase]]] = {
    "kinds": kinds,
    "null": null,
    "catalogue": catalogue,
    "small": small,
    "six": six,
    "removed": removed,
    "mixed": mixed,
}


def pair_of(law_case: LawCase) -> Pair:
    """Drive the robot of a case twice: as the case says, and on another drive from the same start and with the same
    events. A robot on figure-eights drives others of them."""
    case = law_case.case
    if law_case.set_name == "six":
        first, fresh = (messy(case.seed, RICH, drive=number).recording for number in (0, 1))
        return Pair(first, fresh, None, None, None)
    truth = _made_small(truth_of(case)) if law_case.set_name == "small" else truth_of(case)
    again = replace(case, run=1, manoeuvre=EIGHT if case.manoeuvre == EIGHT else HELD_OUT)
    learned, judged = recorded(truth), recorded(replace(truth, case=again))
    return Pair(learned.recording, judged.recording, truth, learned, judged)


def _made_small(truth: Truth) -> Truth:
    """Return the truth with a small part of what it hides, in other respects as it was."""
    parameters = {name: value if name in SHAPES else SMALL * value for name, value in truth.parameters.items()}
    return replace(truth, parameters=parameters)


def _few(seeds: int) -> int:
    return (seeds + EACH - 1) // EACH
