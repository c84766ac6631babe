"""Upper bound of the wheels' stopping time after the controller's cable was pulled: counts gained over the speed."""

from collections.abc import Callable
from dataclasses import dataclass

from cmr.msg import motor_feedback_t
from robot_driver.bringup.bench import COASTING, SILENCE, ZERO_FIRST, Bench, CannotTell
from robot_driver.guided import Guide, no_or_yes

SECONDS, TRIES = 1.0, 15  # s of each motion; motions until the cable is out
PAUSE = 1.0  # s between them
BACK = 60.0  # s within which it must be plugged in again
STEADY = 0.3  # s before the last reading, over which the speed is taken
GONE = 0.3  # s without feedback that shows that the cable is out
DRIVEN = 0.9  # of the duty at the last reading, if the cable was pulled during the motion
ON_ITS_WAY = 0.05  # s within which a command may have arrived although its reply was lost
FEWEST = 20  # ticks in that time; slower wheels are not sufficient


@dataclass(frozen=True)
class StopTime:
    """An upper bound of the stopping time (s); None if it was not measured, with `why`."""

    seconds: float | None
    why: str = ""


def find_stop_time(bench: Bench, guide: Guide, duty: float) -> StopTime:
    """Ask the person to pull the cable while both wheels turn, lifted. Raises CannotTell."""
    text = (
        f"The wheels must be off the floor. Both turn for {SECONDS:g} s with {duty:.0%} duty, then rest for "
        f"{PAUSE:g} s, at most {TRIES} times. Take the USB cable of the motor controller, and pull it while they turn; "
        "do not switch the battery off. Do you want to measure how fast they stop?"
    )
    if guide.ask("stop.begin", text, no_or_yes("yes, turn the wheels", "no, leave this step out")) == "no":
        return StopTime(None, "left out")
    bench.limit = max(bench.limit, duty)
    for _ in range(TRIES):
        with bench.listening() as heard:
            turned = _turned(bench, guide, duty)
            if turned is None:
                return StopTime(None, "the cable was not pulled: ended by you")
            if bench.silent_for < GONE:
                bench.run(PAUSE)
            if bench.silent_for < GONE:
                continue
            before = [message for message in heard.feedback if message.received_utime]
            guide.say("stop.plug", "The cable is out. Wait until the wheels stand, then plug it in again.")
            _wait(bench, lambda: bench.silent_for < GONE)
            if was_driven(before[-1], duty, turned):
                return StopTime(bound(before, heard.feedback[-1]))
        guide.say("stop.repeat", "The cable was pulled while the wheels rested, which shows nothing. Once more.")
    return StopTime(None, "the cable was not pulled while the wheels turned")


def was_driven(last: motor_feedback_t, duty: float, until: int) -> bool:
    """Return whether this duty was in force at the last reading, clearly before the end of the motion (us)."""
    applied = min(abs(last.applied_left), abs(last.applied_right))
    return applied >= DRIVEN * duty and last.received_utime < until - ON_ITS_WAY * 1e6


def bound(before: list[motor_feedback_t], after: motor_feedback_t) -> float:
    """Return the time (s) to gain the counts since the last reading at the speed before."""
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


def _turned(bench: Bench, guide: Guide, duty: float) -> int | None:
    """Turn both wheels once; return the end time (us), None if a key ended it."""
    bench.want(0.0, 0.0)
    bench.run(ZERO_FIRST)
    bench.check()
    try:
        with guide.motion("stop.turns", "Both wheels turn now, for 1 s. Pull the USB cable.", SECONDS) as motion:
            start = bench.host.monotonic()
            while not motion.ended(bench.host.monotonic() - start):
                bench.want(duty, duty)
                bench.turn()
                if bench.silent_for < SILENCE:
                    bench.check()
    finally:
        bench.want(0.0, 0.0)
    ended = bench.host.utime()
    if motion.by_person:
        return None
    bench.run(COASTING)
    return ended


def _wait(bench: Bench, until: Callable[[], bool]) -> None:
    end = bench.host.monotonic() + BACK
    while not until():
        if bench.host.monotonic() > end:
            raise CannotTell("the controller did not come back")
        bench.turn()
    bench.run(SILENCE)
