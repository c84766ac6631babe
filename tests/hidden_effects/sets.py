"""The cases by which a diagnosis is measured, set by set; `seeds` [20] says how many robots there are of each kind."""

from collections.abc import Callable, Mapping
from itertools import combinations

import numpy as np

from tests.hidden_effects.cases import BRIEF, CONTROLLED_WINDOWS, EIGHT, EIGHT_OPEN, RICH, SHORT_SECONDS, WINDOWS, Case
from tests.hidden_effects.unknown import FRICTIONS, UNKNOWN
from tests.reference_plant import TYPICAL

SEEDS = 20
# The robots of these sets take duties: what shows in others is not hidden in them.
WITH_DUTIES = [effect for effect in TYPICAL if effect != "wheel_separation_error"]
NULL_NOISES = ("realistic", "threefold", "white", "threefold_white", "slow", "threefold_slow")
# Either name says the same of the data, so both at once are one effect.
SAME_MATHEMATICS = (frozenset({"wheel_radius_scale", "encoder_scale"}),)
PAIRS = [pair for pair in combinations(WITH_DUTIES, 2) if frozenset(pair) not in SAME_MATHEMATICS]
# Beside late poses in windows, one of these is hidden, or nothing more (None).
IN_WINDOWS = (
    *(None, "pose_offset", "travel_reduction", "wheel_radius_asymmetry", "gyro_scale", "command_delay", "turn_slip"),
    *("gyro_latency", "motor_gain_asymmetry", "gyro_bias", "coulomb_friction", "wheel_speed_latency"),
)
IN_CONTROLLED_WINDOWS = (
    *(None, "pose_offset", "travel_reduction", "wheel_radius_asymmetry", "gyro_scale", "command_delay", "turn_slip"),
    *("gyro_latency", "turn_rate_limit", "wheel_separation_error", "wheel_speed_latency"),
)
TWO_HOURS = 61  # rich drives


def single(seeds: int) -> list[Case]:
    """Return every effect on the rich drive."""
    return [Case((effect,), RICH, seed) for seed in range(seeds) for effect in WITH_DUTIES]


def brief(seeds: int) -> list[Case]:
    """Return every effect on the short drive, which takes less than a minute on 2 m x 2 m."""
    return [Case((effect,), BRIEF, seed) for seed in range(seeds) for effect in WITH_DUTIES]


def eight(seeds: int) -> list[Case]:
    """Return every effect on figure-eights alone."""
    return [Case((effect,), EIGHT, seed) for seed in range(seeds) for effect in WITH_DUTIES]


def null(seeds: int) -> list[Case]:
    """Return robots without any effect, on every drive and with every kind of noise."""
    drives = [(drive, noise) for noise in NULL_NOISES for drive in (RICH, EIGHT)]
    return [Case((), *_turn(drives, seed)) for seed in range(15 * seeds)]


def short(seeds: int) -> list[Case]:
    """Return robots without any effect, on short drives."""
    drives = [(drive, noise) for noise in ("realistic", "threefold_slow") for drive in SHORT_SECONDS]
    return [Case((), *_turn(drives, seed)) for seed in range(6 * seeds)]


def coarse(seeds: int) -> list[Case]:
    """Return robots with 48 ticks per turn and no other effect."""
    drives = [(drive, "coarse") for drive in (EIGHT, RICH, EIGHT_OPEN)]
    return [Case((), *_turn(drives, seed)) for seed in range(3 * seeds)]


def pairs(seeds: int) -> list[Case]:
    """Return two effects at once on the rich drive."""
    return [Case(PAIRS[_drawn(seed, len(PAIRS))], RICH, seed) for seed in range(5 * seeds)]


def unknown(seeds: int) -> list[Case]:
    """Return physics that no effect describes, on the rich drive."""
    return [Case((kind,), RICH, seed) for seed in range((seeds + 1) // 2) for kind in UNKNOWN]


def friction(seeds: int) -> list[Case]:
    """Return friction by other laws than the catalogue's, on the rich drive."""
    laws = [law for law in FRICTIONS if law != "dry"]
    effects = ("coulomb_friction", "static_friction")
    return [Case((effect,), RICH, seed, friction=law) for seed in range(seeds) for effect in effects for law in laws]


def gain(seeds: int) -> list[Case]:
    """Return every effect on the rich drive, of which a fresh drive of the same robot is to be predicted."""
    return [Case((effect,), RICH, 500 + seed) for seed in range((seeds + 9) // 10) for effect in WITH_DUTIES]


def length(seeds: int) -> list[Case]:
    """Return drives of two, four and eight minutes."""
    return [
        Case(("coulomb_friction",), RICH, seed, repeats=repeats)
        for seed in range((seeds + 4) // 5)
        for repeats in (1, 2, 4)
    ]


def command(seeds: int) -> list[Case]:
    """Return drives for the whole command, report included."""
    return [Case((effect,), RICH, 600 + seed) for seed, effect in enumerate(WITH_DUTIES[: (seeds + 3) // 4])]


def windows(seeds: int) -> list[Case]:
    """Return recordings in windows with late poses, of robots that take duties and of those that take (v, omega)."""
    kinds = ((WINDOWS, IN_WINDOWS), (CONTROLLED_WINDOWS, IN_CONTROLLED_WINDOWS))
    return [
        Case((*filter(None, [effects[seed % len(effects)]]), "pose_latency"), manoeuvre, seed)
        for seed in range(2 * seeds)
        for manoeuvre, effects in kinds
    ]


def hours(_seeds: int) -> list[Case]:
    """Return one drive of two hours."""
    return [Case(("coulomb_friction",), RICH, 700, repeats=TWO_HOURS)]


SETS: Mapping[str, Callable[[int], list[Case]]] = {
    "single": single,
    "brief": brief,
    "eight": eight,
    "null": null,
    "short": short,
    "coarse": coarse,
    "pairs": pairs,
    "unknown": unknown,
    "friction": friction,
    "gain": gain,
    "length": length,
    "windows": windows,
    "command": command,
    "hours": hours,
}


def _turn(drives: list[tuple[str, str]], seed: int) -> tuple[str, int, str]:
    """Return manoeuvre, seed and noise of the case with this number, all in turn."""
    manoeuvre, noise = drives[seed % len(drives)]
    return manoeuvre, seed, noise


def _drawn(seed: int, count: int) -> int:
    return int(np.random.default_rng([seed, 7]).integers(count))
