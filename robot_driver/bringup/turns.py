"""Encoder counts per wheel turn, from ten turns by hand, then seven if no data sheet confirms them."""

from collections.abc import Sequence
from dataclasses import dataclass

from robot_driver.bringup.bench import Bench, CannotTell
from robot_driver.bringup.motors import Side
from robot_driver.guided import Choice, Guide, no_or_yes

SAME = 0.02  # relative difference of two counts of the same encoder; 7 degrees in ten turns are 0.002
NEAR = 0.012  # relative error of turns by hand
FACTORS = {1.0: "", 2.0: "twice", 4.0: "four times", 0.5: "half of", 0.25: "a quarter of"}
# Numbers of turns counted, in order: if one is too many or too few each time, the two results still differ.
ROUNDS = (10, 7, 10, 7, 10, 7)
WORDS = {6: "six", 7: "seven", 8: "eight", 9: "nine", 10: "ten", 11: "eleven"}
FEWEST = 5.0  # counts per turn; no encoder has fewer
TRIES = 6  # of one wheel
# Counts per wheel turn, four per pulse, of common robots.
USUAL: dict[str, tuple[int, ...]] = {
    "mbot": (3744, 1560, 3120),
    "roboclaw": (1200, 1920, 2048, 2248, 3200, 3264, 4096, 4480, 4741, 6400, 8192, 8400, 9600),
    "roboclaw-pair": (1200, 1920, 2048, 3200, 4096, 4480, 6400, 8192, 8400, 9600),
    "roboteq": (1024, 2000, 2048, 4000, 4096, 8192, 10000, 16384),
}


@dataclass(frozen=True)
class Turns:
    """The counts per turn, with the reason."""

    ticks_per_turn: int
    why: str


@dataclass(frozen=True)
class Count:
    """The count of one wheel per turn, from this number of turns."""

    side: Side
    turns: int
    per_turn: float


def find_turns(bench: Bench, guide: Guide, sides: Sequence[Side], controller: str) -> Turns:
    """Let the person turn wheels with these encoders by hand. Raises CannotTell."""
    stated = guide.number(
        "ticks.stated",
        "How many encoder counts has a turn of a wheel, by the data sheets (counts of the encoder, four for each "
        "pulse, times the gear ratio)? 0 if you do not know.",
        "counts",
        0.0,
        1e7,
    )
    counts: list[Count] = []
    for turns in ROUNDS:
        latest = [Count(side, turns, _counted(bench, guide, side, turns)) for side in sides]
        counts += latest
        if (mean := agreed(counts, sides, stated)) is not None:
            return _made_of(mean, stated, controller, guide)
        guide.say("ticks.repeat", f"{objection(latest, stated, first=len(counts) == len(latest))} Please count again.")
    raise CannotTell(f"turns were counted differently {len(ROUNDS)} times. Mark the wheel with tape, and count aloud")


def agreed(counts: Sequence[Count], sides: Sequence[Side], stated: float) -> float | None:
    """Return the counts per turn on which every wheel and two sources agree; None otherwise.

    Two sources are the data sheet and a count, or counts of ten and of seven turns.
    """
    for one in counts:
        same = [other for other in counts if abs(other.per_turn / one.per_turn - 1.0) < SAME]
        mean = sum(count.per_turn for count in same) / len(same)
        is_stated = bool(stated) and nearest(mean, stated) is not None
        if {count.side for count in same} == set(sides) and (is_stated or len({count.turns for count in same}) > 1):
            return mean
    return None


def objection(latest: Sequence[Count], stated: float, *, first: bool) -> str:
    """Return why the counts of this round, the `first` one or a later one, are inconclusive."""
    values = [count.per_turn for count in latest]
    mean, turns = sum(values) / len(values), latest[0].turns
    if max(values) - min(values) > SAME * mean:
        words = " and ".join(f"{count.per_turn:.0f} {count.side.value}" for count in latest)
        return f"The wheels differ: {words} counts for a turn. One of them was probably turned once too often or less."
    if stated and nearest(mean, stated) is None:
        ratio, words = miscounted(mean, stated, turns)
        hint = f" It is {ratio:.0%} of that." if not words else f" It looks as if {words} turns were made."
        return f"A turn has {mean:.0f} counts by hand, which does not fit {stated:.0f} by the data sheet.{hint}"
    other = "nothing to compare that with" if first else "no other count that agrees"
    return f"A turn has {mean:.0f} counts by hand; there is {other}."


def nearest(mean: float, stated: float) -> float | None:
    """Return the factor to the stated counts, if a common one fits."""
    return next((factor for factor in FACTORS if abs(mean / (stated * factor) - 1.0) < NEAR), None)


def miscounted(mean: float, stated: float, turns: int) -> tuple[float, str]:
    """Return the share of the intended turns made, and their number in words, if one more or fewer was made."""
    for factor in FACTORS:
        for made in (turns - 1, turns + 1):
            if abs(mean / (stated * factor * made / turns) - 1.0) < NEAR:
                return made / turns, WORDS[made]
    return mean / stated, ""


def _made_of(mean: float, stated: float, controller: str, guide: Guide) -> Turns:
    factor = nearest(mean, stated) if stated else None
    if factor is not None:
        ticks = round(stated * factor)
        why = f"counted {mean:.0f} by hand; the data sheet's {stated:.0f} fits"
        if factor != 1.0:
            why = f"counted {mean:.0f} by hand: {FACTORS[factor]} the data sheet's {stated:.0f}; it may mean pulses"
        return Turns(ticks, why)
    if stated:
        text = f"The data sheet says {stated:.0f} counts, but {mean:.0f} were counted twice. Is the count to be used?"
        if guide.ask("ticks.counted", text, no_or_yes("yes, use what was counted", "no")) == "no":
            raise CannotTell(f"the data sheet says {stated:.0f} counts for a turn, and by hand it has {mean:.0f}")
        return Turns(round(mean), f"counted twice by hand; the data sheet's {stated:.0f} does not fit")
    usual = min(USUAL.get(controller, ()), key=lambda ticks: abs(ticks / mean - 1.0), default=0)
    if usual and abs(usual / mean - 1.0) < NEAR:
        text = f"By hand a turn has {mean:.0f} counts. {usual} would be usual with this controller. Is it {usual}?"
        choices = (*no_or_yes(f"yes, {usual}", "no, use what was counted"), Choice("unknown", "I do not know"))
        if guide.ask("ticks.usual", text, choices) == "yes":
            return Turns(usual, f"counted {mean:.0f} by hand; {usual} is usual, and was confirmed")
    return Turns(round(mean), "counted by hand")


def _counted(bench: Bench, guide: Guide, side: Side, turns: int) -> float:
    """Let the person turn one wheel this many times; return counts per turn, positive."""
    for _ in range(TRIES):
        bench.run(0.1)
        before = bench.ticks
        guide.ask(
            f"ticks.{side.value}.{WORDS[turns]}",
            f"Turn the {side.value} wheel by hand, forward, exactly {WORDS[turns]} full turns. Mark it with tape, and "
            "end with the mark where it began.",
            (Choice("done", f"it has made {WORDS[turns]} turns forward"),),
        )
        bench.run(0.1)
        place = 0 if side is Side.LEFT else 1
        counted = bench.ticks[place] - before[place]
        if counted >= FEWEST * turns:
            return counted / turns
        if abs(counted) < FEWEST * turns:
            guide.say("ticks.nothing", f"Its encoder counted {counted}: too few for {WORDS[turns]} turns. Once more.")
            continue
        text = f"The {side.value} wheel was counted backward. Which way did you turn it?"
        choices = Choice("forward", "forward, as if the robot drove forward"), Choice("backward", "backward")
        if guide.ask("ticks.direction", text, choices) == "forward":
            raise CannotTell(
                f"the {side.value} wheel was turned forward by hand but counted backward, which contradicts the step "
                "motors: run that step again"
            )
    raise CannotTell(f"the {side.value} encoder does not count turns by hand. Check its cable")
