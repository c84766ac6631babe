"""Encoder counts per turn of a wheel, by ten turns by hand, and what the data sheet or usual encoders make of them."""

from collections.abc import Sequence
from dataclasses import dataclass

from robot_driver.bringup.bench import Bench, CannotTell
from robot_driver.bringup.motors import Side
from robot_driver.guided import Choice, Guide, no_or_yes

TURNS = 10
SAME = 0.02  # share by which two counts of ten turns differ that are of the same encoder; 7 degrees make 0.002
NEAR = 0.012  # share by which ten turns by hand miss what an encoder has
FACTORS = {1.0: "", 2.0: "twice", 4.0: "four times", 0.5: "half of", 0.25: "a quarter of"}
MISCOUNTED = {9 / 10: "nine turns", 11 / 10: "eleven turns"}  # what ten turns were instead
FEWEST = 5.0  # counts per turn; no encoder has fewer
ROUNDS = 6
# Counts per turn of the wheel, four per pulse, of what robots of this kind often have.
USUAL: dict[str, tuple[int, ...]] = {
    "mbot": (3744, 1560, 3120),
    "roboclaw": (1200, 1920, 2048, 2248, 3200, 3264, 4096, 4480, 4741, 6400, 8192, 8400, 9600),
    "roboclaw-pair": (1200, 1920, 2048, 3200, 4096, 4480, 6400, 8192, 8400, 9600),
    "roboteq": (1024, 2000, 2048, 4000, 4096, 8192, 10000, 16384),
}


@dataclass(frozen=True)
class Turns:
    """The counts per turn, whether they are `exact` (not only measured by hand), and why they are these."""

    ticks_per_turn: int
    exact: bool
    why: str


def find_turns(bench: Bench, guide: Guide, sides: Sequence[Side], controller: str) -> Turns:
    """Have wheels with these encoders turned by hand; raises CannotTell."""
    stated = guide.number(
        "ticks.stated",
        "How many encoder counts has a turn of a wheel, by the data sheets (counts of the encoder, four for each "
        "pulse, times the gear ratio)? 0 if you do not know.",
        "counts",
        0.0,
        1e7,
    )
    before: float | None = None
    for _ in range(ROUNDS):
        counted = [_counted(bench, guide, side) for side in sides]
        mean = sum(counted) / len(counted)
        if problem := objection(counted, sides, stated, before):
            before = mean if max(counted) - min(counted) < SAME * mean else before
            guide.say("ticks.repeat", f"{problem} Please count once more.")
            continue
        return _made_of(mean, stated, controller, guide)
    raise CannotTell(f"ten turns were counted differently {ROUNDS} times. Mark the wheel with tape, and count aloud")


def objection(counted: Sequence[float], sides: Sequence[Side], stated: float, before: float | None) -> str:
    """Return why ten turns have to be counted again; "" if they need not."""
    mean = sum(counted) / len(counted)
    if max(counted) - min(counted) > SAME * mean:
        values = " and ".join(f"{value:.0f} {side.value}" for value, side in zip(counted, sides, strict=True))
        return f"The wheels differ: {values} counts for a turn. One of them was probably turned once too often or less."
    if before is not None and abs(before - mean) < SAME * mean:
        return ""  # counted twice, with the same result
    if stated and nearest(mean, stated) is None:
        ratio, words = miscounted(mean, stated)
        hint = f" This is {ratio:.0%} of what {words} would be." if not words else f" It looks as if {words} were made."
        return f"A turn has {mean:.0f} counts by hand, which does not fit {stated:.0f} by the data sheet.{hint}"
    if not stated:  # nor has the same been counted twice
        other = "nothing to compare that with" if before is None else f"another count before, {before:.0f}"
        return f"A turn has {mean:.0f} counts by hand; there is {other}."
    return ""


def nearest(mean: float, stated: float) -> float | None:
    """Return by which factor an encoder has more counts than stated, if one of those that occur fits."""
    return next((factor for factor in FACTORS if abs(mean / (stated * factor) - 1.0) < NEAR), None)


def miscounted(mean: float, stated: float) -> tuple[float, str]:
    """Return how many turns were made in place of ten, in words, if that explains the difference; else ""."""
    for factor in FACTORS:
        for share, words in MISCOUNTED.items():
            if abs(mean / (stated * factor * share) - 1.0) < NEAR:
                return share, words
    return mean / stated, ""


def _made_of(mean: float, stated: float, controller: str, guide: Guide) -> Turns:
    factor = nearest(mean, stated) if stated else None
    if factor is not None:
        ticks = round(stated * factor)
        why = f"counted {mean:.0f} by hand; the data sheet's {stated:.0f} fits"
        if factor != 1.0:
            why = f"counted {mean:.0f} by hand: {FACTORS[factor]} the data sheet's {stated:.0f}; it may mean pulses"
        return Turns(ticks, True, why)
    if stated:
        text = f"The data sheet says {stated:.0f} counts, but {mean:.0f} were counted twice. Is the count to be used?"
        if guide.ask("ticks.counted", text, no_or_yes("yes, use what was counted", "no")) == "no":
            raise CannotTell(f"the data sheet says {stated:.0f} counts for a turn, and by hand it has {mean:.0f}")
        return Turns(round(mean), False, f"counted twice by hand; the data sheet's {stated:.0f} does not fit")
    usual = min(USUAL.get(controller, ()), key=lambda ticks: abs(ticks / mean - 1.0), default=0)
    if usual and abs(usual / mean - 1.0) < NEAR:
        text = f"By hand a turn has {mean:.0f} counts. {usual} would be usual with this controller. Is it {usual}?"
        choices = (*no_or_yes(f"yes, {usual}", "no, use what was counted"), Choice("unknown", "I do not know"))
        if guide.ask("ticks.usual", text, choices) == "yes":
            return Turns(usual, True, f"counted {mean:.0f} by hand; {usual} is usual, and was confirmed")
    return Turns(round(mean), False, "counted by hand")


def _counted(bench: Bench, guide: Guide, side: Side) -> float:
    """Have one wheel turned ten times; return counts per turn, positive."""
    for _ in range(ROUNDS):
        bench.run(0.1)
        before = bench.ticks
        guide.ask(
            f"ticks.{side.value}",
            f"Turn the {side.value} wheel by hand, forward, exactly ten full turns. Mark it with tape, and end with "
            "the mark where it began.",
            (Choice("done", "it has made ten turns forward"),),
        )
        bench.run(0.1)
        place = 0 if side is Side.LEFT else 1
        counted = (bench.ticks[place] - before[place]) / TURNS
        if counted >= FEWEST:
            return counted
        if abs(counted) < FEWEST:
            guide.say("ticks.nothing", f"Its encoder counted {counted * TURNS:.0f}: too few for ten turns. Once more.")
            continue
        text = f"The {side.value} wheel was counted backward. Which way did you turn it?"
        choices = Choice("forward", "forward, as if the robot drove forward"), Choice("backward", "backward")
        if guide.ask("ticks.direction", text, choices) == "forward":
            raise CannotTell(
                f"the {side.value} wheel was turned forward by hand but counted backward, which contradicts the step "
                "motors: run that step again"
            )
    raise CannotTell(f"the {side.value} encoder does not count turns by hand. Check its cable")
