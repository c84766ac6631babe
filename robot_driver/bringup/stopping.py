"""How long wheels turn at most after the cable to the controller was pulled: counts gained, over the speed before."""

from collections.abc import Callable
from dataclasses import dataclass

from cmr.msg import motor_feedback_t
from robot_driver.bringup.bench import SILENCE, ZERO_FIRST, Bench, CannotTell
from robot_driver.guided import Guide, no_or_yes

LONGEST = 15.0  # s that the wheels turn until the cable is out
BACK = 60.0  # s until it is in again
STEADY = 0.3  # s before the last reading, over which the speed is taken
GONE = 0.3  # s without feedback, after which the cable is out
FEWEST = 20  # ticks in that time; slower wheels measure nothing


@dataclass(frozen=True)
class StopTime:
    """An upper bound of the time (s) that the wheels went on; None where it was not measured, `why` says so."""

    seconds: float | None
    why: str = ""


def find_stop_time(bench: Bench, guide: Guide, duty: float) -> StopTime:
    """Have the cable pulled while both wheels turn, lifted. Raises CannotTell."""
    text = (
        "The wheels must be off the floor. They turn for at most 15 s, with at most "
        f"{duty:.0%} duty. Meanwhile pull the USB cable of the motor controller, and do not switch its battery off. "
        "Do you want to measure how fast they stop?"
    )
    if guide.ask("stop.begin", text, no_or_yes("yes, turn the wheels", "no, leave this step out")) == "no":
        return StopTime(None, "left out")
    bench.limit = max(bench.limit, duty)
    with bench.listening() as heard:
        if not _turn_until_silent(bench, guide, duty):
            return StopTime(None, "the cable was not pulled")
        before = [message for message in heard.feedback if message.received_utime]
        guide.say("stop.plug", "The cable is out. Wait until the wheels stand, then plug it in again.")
        _wait(bench, lambda: bench.silent_for < GONE)
        after = heard.feedback[-1]
    return StopTime(bound(before, after))


def bound(before: list[motor_feedback_t], after: motor_feedback_t) -> float:
    """Return the time (s) that the counts gained since the last reading would have taken at the speed before."""
    last = before[-1]
    earlier = next((one for one in before if one.utime >= last.utime - STEADY * 1e6), last)
    seconds = (last.utime - earlier.utime) / 1e6
    bounds = []
    for side in ("left", "right"):
        ticks = f"ticks_{side}"
        steps = abs(int(getattr(last, ticks)) - int(getattr(earlier, ticks)))
        if steps >= FEWEST:
            gained = abs(int(getattr(after, ticks)) - int(getattr(last, ticks)))
            bounds.append(gained / steps * seconds)
    if not bounds:
        raise CannotTell("the wheels turned too slowly for a measurement")
    if max(bounds) == 0.0:
        raise CannotTell(
            "the counts did not go on while the cable was out: the controller is fed by USB, or was reset, and forgot "
            "them"
        )
    return max(bounds)


def _turn_until_silent(bench: Bench, guide: Guide, duty: float) -> bool:
    """Turn both wheels; return whether the controller fell silent meanwhile."""
    bench.want(0.0, 0.0)
    bench.run(ZERO_FIRST)
    bench.check()
    try:
        with guide.motion("stop.turns", "Both wheels turn now. Pull the USB cable.", LONGEST) as motion:
            start = bench.host.monotonic()
            while not motion.ended(bench.host.monotonic() - start):
                bench.want(duty, duty)
                bench.turn()
                if bench.silent_for > GONE:
                    return True
                if bench.silent_for < SILENCE:
                    bench.check()
            return False
    finally:
        bench.want(0.0, 0.0)


def _wait(bench: Bench, until: Callable[[], bool]) -> None:
    end = bench.host.monotonic() + BACK
    while not until():
        if bench.host.monotonic() > end:
            raise CannotTell("the controller did not come back")
        bench.turn()
    bench.run(SILENCE)
