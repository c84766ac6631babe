"""Which motor drives which wheel in which direction, and which encoder counts it: one motor at a time, seen by a
person.
"""

from dataclasses import dataclass
from enum import Enum

from robot_driver.bringup.bench import FIRST_LIMIT, LIMIT, Bench, CannotTell
from robot_driver.encoders import Wiring
from robot_driver.guided import Choice, Guide, no_or_yes

SECONDS = 1.0  # of each motion
STEP = 0.02  # duty
MOVED = 4  # ticks; jitter of an encoder at rest is one or two
SHARE = 0.2  # of an encoder's counts when its wheel turns: with fewer it was only shaken
TRIES = 3
CHANNELS = ("first", "second")


class Side(Enum):
    """A side of the robot, seen in the direction in which it drives forward."""

    LEFT = "left"
    RIGHT = "right"


SEEN = {
    "lf": (Side.LEFT, 1),
    "lb": (Side.LEFT, -1),
    "rf": (Side.RIGHT, 1),
    "rb": (Side.RIGHT, -1),
}
CHOICES = (
    Choice("lf", "the left wheel turned as if the robot drove forward"),
    Choice("lb", "the left wheel turned as if it drove backward"),
    Choice("rf", "the right wheel turned as if the robot drove forward"),
    Choice("rb", "the right wheel turned as if it drove backward"),
    Choice("none", "nothing turned"),
    Choice("both", "both wheels turned"),
    Choice("again", "I did not see it: once more"),
)


@dataclass(frozen=True)
class Observation:
    """The result of one channel at a positive duty: the wheel seen, its direction (1: forward), counts of both
    channels.
    """

    side: Side
    direction: int
    counts: tuple[int, int]
    duty: float


@dataclass(frozen=True)
class Motors:
    """The findings: the wiring, dead encoders, and the duty that turned both wheels."""

    wiring: Wiring
    dead: tuple[Side, ...]
    duty: float


def find_motors(bench: Bench, guide: Guide) -> Motors:
    """Turn both motors, one at a time; `bench` has no wiring, so its sides are the controller's channels.

    Raises CannotTell.
    """
    for _ in range(TRIES):
        both = _observed(bench, guide, 0), _observed(bench, guide, 1)
        if both[0].side is not both[1].side:
            return decided(*both)
        guide.say(
            "motors.same",
            f"Both channels cannot turn the {both[0].side.value} wheel alone. Stand behind the robot, looking in the "
            "direction in which it drives, and see both once more.",
        )
    raise CannotTell(f"both motors were seen to turn the {both[0].side.value} wheel. Check what they drive")


def decided(first: Observation, second: Observation) -> Motors:
    """Combine two observations of different wheels.

    Raises CannotTell if they contradict each other.
    """
    crossed, against, dead = set(), {}, []
    both = first, second
    most = tuple(max(abs(one.counts[channel]) for one in both) for channel in (0, 1))
    for channel, one in enumerate(both):
        counting = [place for place in _counting(one.counts) if abs(one.counts[place]) >= SHARE * most[place]]
        if len(counting) > 1:
            raise CannotTell(
                f"both encoders counted ({one.counts[0]} and {one.counts[1]}) while only the {one.side.value} wheel "
                "was seen to turn. Check that the wheels are off the floor and are not joined"
            )
        if not counting:
            dead.append(one.side)
            continue
        crossed.add(counting[0] != channel)
        against[one.side] = one.counts[counting[0]] < 0
    if len(dead) == 2:
        raise CannotTell("no encoder counts: check their power and their cables")
    if len(crossed) > 1:
        raise CannotTell(
            "both wheels were counted by the same channel, which cannot be. Check that each encoder has a cable of "
            "its own"
        )
    backward = {one.side: one.direction < 0 for one in both}
    wiring = Wiring(
        swap=first.side is Side.RIGHT,
        invert_left=backward[Side.LEFT],
        invert_right=backward[Side.RIGHT],
        swap_encoders=crossed.pop(),
        invert_left_encoder=against.get(Side.LEFT, False),
        invert_right_encoder=against.get(Side.RIGHT, False),
    )
    return Motors(wiring, tuple(dead), max(first.duty, second.duty))


def _counting(counts: tuple[int, int]) -> list[int]:
    """Return the channels whose encoders counted."""
    most = max(map(abs, counts))
    return [channel for channel in (0, 1) if abs(counts[channel]) >= max(MOVED, SHARE * most)]


def _observed(bench: Bench, guide: Guide, channel: int) -> Observation:
    """Turn one motor until the person has seen which wheel it turns."""
    duty, looked_again = FIRST_LIMIT, False
    while True:
        counts = _turned(bench, guide, channel, duty)
        seen = guide.ask(f"motors.{CHANNELS[channel]}.seen", "What did you see?", CHOICES)
        if seen in SEEN:
            return Observation(*SEEN[seen], counts, duty)
        if seen == "both":
            raise CannotTell(f"one motor, that of the {CHANNELS[channel]} channel, turned both wheels")
        if seen == "none" and _counting(counts) and not looked_again:
            looked_again = True
            guide.say("motors.counted", "But an encoder counted: something has turned. Look once more.")
        elif seen == "none":  # or the motion was too small to be visible
            looked_again = False
            duty = _more(bench, guide, channel, duty, counts)


def _more(bench: Bench, guide: Guide, channel: int, duty: float, counts: tuple[int, int]) -> float:
    """Return the next larger duty, if the person agrees."""
    if duty + STEP > LIMIT + 1e-9 and _counting(counts):
        raise CannotTell(
            f"nothing was seen to turn at {LIMIT:.0%} duty, but the encoders counted {counts[0]} and {counts[1]}"
        )
    if duty + STEP > LIMIT + 1e-9:
        raise CannotTell(
            f"the motor of the {CHANNELS[channel]} channel turned nothing at {LIMIT:.0%} duty. Check the motor's "
            "cable, its power, and that nothing blocks the wheel"
        )
    if bench.limit < LIMIT:
        yes = "yes, in small steps up to 20 %"
        text = f"Nothing turned at {FIRST_LIMIT:.0%} duty: friction may hold it. May the motors get more?"
        if guide.ask("motors.more", text, no_or_yes(yes, "no, leave it")) == "no":
            raise CannotTell(f"nothing turned at {FIRST_LIMIT:.0%} duty, and more was not allowed")
        bench.limit = LIMIT
    return duty + STEP


def _turned(bench: Bench, guide: Guide, channel: int, duty: float) -> tuple[int, int]:
    """Turn a motor once; return the counts of both channels."""
    bench.run(0.1)
    before = bench.ticks
    text = f"The motor of the {CHANNELS[channel]} channel turns now, for {SECONDS:g} s with {duty:.0%} of full drive."
    duties = (duty, 0.0) if channel == 0 else (0.0, duty)
    bench.move(guide, f"motors.{CHANNELS[channel]}.turns", text, duties, SECONDS)
    after = bench.ticks
    return after[0] - before[0], after[1] - before[1]
