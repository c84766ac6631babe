"""The drive on the floor: half a metre ahead, a quarter turn left, on, and a quarter turn right, held by the wheels."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from cmr.msg import motor_feedback_t
from robot_driver.bringup.bench import Bench, CannotTell, Readings
from robot_driver.bringup.odometry import TURN
from robot_driver.guided import Guide, no_or_yes

SECONDS = 20.0  # longest duration of the drive
LIMIT = 0.45  # duty; limit of the drive
SPEED, TURNING_SPEED = 0.15, 0.10  # m/s of the wheels, straight ahead and in turns
SLOWEST = 0.04  # m/s, at the end of each part
SLOWING = 0.25  # m/s^2
BEYOND, BEYOND_ANGLE = 0.15, math.radians(40.0)  # m, rad beyond the plan at which the drive ends
NEAR, NEAR_ANGLE = 0.004, math.radians(1.0)
REST = 0.5  # s between parts, and before the first
STUCK, STUCK_DUTY = 1.0, 0.3  # s at that duty within which a wheel must move
GAIN, GROWTH, STRAIGHT = 0.03, 0.12, 3.0  # duty per rad/s; duty/s per rad/s; rad/s per rad
WINDOW = 60_000  # us over which speeds are averaged
ROOM = (
    "Put the robot on the floor. It drives 0.5 m ahead, turns a quarter to the left, drives 0.25 m, and turns a "
    "quarter to the right. Its wheels alone hold it to that, not the poses, and it takes at most 20 s. It needs 1.2 m "
    "ahead, 0.8 m to the left, and 0.5 m to the right and behind, without people and steps, inside of a fence. Is all "
    "that free, and a hand near a key or the emergency stop?"
)


@dataclass(frozen=True)
class Part:
    """One part of the drive: a distance ahead (m), or a rotation on the spot (rad, counter-clockwise)."""

    ahead: float = 0.0
    turn: float = 0.0


PLAN = (Part(ahead=0.5), Part(turn=math.pi / 2), Part(ahead=0.25), Part(turn=-math.pi / 2))


@dataclass(frozen=True)
class Body:
    """Dimensions of the robot: wheel radius and base width (m), ticks per turn."""

    wheel_radius: float
    base_width: float
    ticks_per_turn: int


class FloorDrive:
    """Controls the drive by wheel counts: `duties` in each cycle, None at the end."""

    def __init__(self, body: Body, plan: Sequence[Part] = PLAN) -> None:
        self._body = body
        self._parts = list(plan)
        self._per_tick = TURN * body.wheel_radius / body.ticks_per_turn
        self._start: tuple[int, int] | None = None  # ticks, at the start of the part
        self._recent: list[motor_feedback_t] = []
        self._duties = [0.0, 0.0]
        self._growing = [0.0, 0.0]
        self._rests_until = REST
        self._last = 0.0
        self._moved = [0.0, 0.0]  # when each wheel last moved (s)

    @property
    def is_done(self) -> bool:
        """Whether the whole plan has been driven."""
        return not self._parts

    def duties(self, elapsed: float, feedback: motor_feedback_t) -> tuple[float, float] | None:
        """Return the present duties. Raises CannotTell if the robot leaves the plan."""
        ticks = int(feedback.ticks_left), int(feedback.ticks_right)
        if self._start is None:
            self._start = ticks
        if not self._recent or feedback.utime > self._recent[-1].utime:
            self._recent.append(feedback)
        while len(self._recent) > 2 and self._recent[1].utime < feedback.utime - WINDOW:
            self._recent.pop(0)
        seconds, self._last = elapsed - self._last, elapsed
        if elapsed < self._rests_until:
            return 0.0, 0.0
        if not self._parts:
            return None
        left, right = (self._per_tick * (now - then) for now, then in zip(ticks, self._start, strict=True))
        wanted = self._wheel_speeds(0.5 * (left + right), (right - left) / self._body.base_width)
        if wanted is None:
            self._parts.pop(0)
            self._start, self._growing, self._rests_until = None, [0.0, 0.0], elapsed + REST
            return 0.0, 0.0
        speeds = self._speeds()
        return self._regulated(wanted, speeds, seconds, elapsed)

    def _wheel_speeds(self, ahead: float, turned: float) -> tuple[float, float] | None:
        """Return the desired speeds of the wheels (rad/s), None if the part is complete."""
        part, body = self._parts[0], self._body
        if abs(turned) > abs(part.turn) + BEYOND_ANGLE or abs(ahead) > abs(part.ahead) + BEYOND:
            raise CannotTell(
                f"the robot left the plan: {ahead:.2f} m and {math.degrees(turned):.0f} degrees by its wheels instead "
                f"of {part.ahead:.2f} m and {math.degrees(part.turn):.0f} degrees"
            )
        if part.ahead:
            left = part.ahead - ahead
            if left < NEAR:
                return None
            speed = min(SPEED, max(SLOWEST, math.sqrt(2.0 * SLOWING * left))) / body.wheel_radius
            return speed + STRAIGHT * turned, speed - STRAIGHT * turned
        left = math.copysign(1.0, part.turn) * (part.turn - turned)
        if left < NEAR_ANGLE:
            return None
        way = 0.5 * body.base_width * left
        speed = min(TURNING_SPEED, max(SLOWEST, math.sqrt(2.0 * SLOWING * way))) / body.wheel_radius
        back = ahead / body.wheel_radius  # to stay on the spot
        side = math.copysign(speed, part.turn)
        return -side - back, side - back

    def _speeds(self) -> tuple[float, float]:
        """Return the speeds of both wheels (rad/s)."""
        first, last = self._recent[0], self._recent[-1]
        seconds = (last.utime - first.utime) / 1e6
        if seconds <= 0.0:
            return 0.0, 0.0
        per = TURN / self._body.ticks_per_turn / seconds
        return per * (last.ticks_left - first.ticks_left), per * (last.ticks_right - first.ticks_right)

    def _regulated(
        self, wanted: tuple[float, float], speeds: tuple[float, float], seconds: float, elapsed: float
    ) -> tuple[float, float]:
        duties = []
        for side in (0, 1):
            error = wanted[side] - speeds[side]
            grown = self._growing[side] + GROWTH * error * min(seconds, 0.05)
            self._growing[side] = max(-LIMIT, min(grown, LIMIT))
            duty = max(-LIMIT, min(GAIN * error + self._growing[side], LIMIT))
            if speeds[side] or abs(duty) < STUCK_DUTY:
                self._moved[side] = elapsed
            elif elapsed - self._moved[side] > STUCK:
                raise CannotTell(
                    f"the {('left', 'right')[side]} wheel does not count although it gets {abs(duty):.0%} duty: it is "
                    "blocked, or its encoder has failed"
                )
            duties.append(duty)
        return duties[0], duties[1]


def drive(bench: Bench, guide: Guide, body: Body) -> Readings:
    """Perform the drive, once the person has confirmed the space; return the robot's messages.

    Raises CannotTell.
    """
    yes = "yes, it may drive"
    if guide.ask("floor.fence", ROOM, no_or_yes(yes, "no")) == "no":
        raise CannotTell("there was no space to drive")
    following = FloorDrive(body)
    before, bench.limit = bench.limit, LIMIT

    def duties(elapsed: float) -> tuple[float, float] | None:
        assert bench.latest is not None
        return following.duties(elapsed, bench.latest)

    try:
        with bench.listening() as heard:
            bench.run(1.0)
            ended = bench.steer(guide, "floor.drives", "The robot drives now.", duties, SECONDS)
            bench.run(1.0)
    finally:
        bench.limit = before
    if ended or not following.is_done:
        raise CannotTell("the drive was ended before it was complete")
    return heard
