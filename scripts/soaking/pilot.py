"""Command the robot in a soak test: steady commands, pauses, emergency stops, and invalid commands between them."""

import math
from collections import Counter
from random import Random

import lcm

from cmr.bus.bus import Bus
from cmr.bus.messages import make, now_utime
from cmr.bus.streams import ESTOP, MOTOR_COMMAND
from cmr.msg import estop_t, motor_command_t
from soaking.checks import STOP_WITHIN, US_PER_S, DriveChecks, Interval

LARGEST_DUTY = 0.8
INVALID_DUTY = 0.95  # in range, but used only in messages that the driver must reject
REST = (3.0, 12.0)  # s between two events
DRIVES_WITHIN = 2 * US_PER_S  # us after the robot may drive again
INVALID_SHARE = 0.05  # of cycles that send an invalid command as well
HOUR = 3_600 * US_PER_S


class Pilot:
    """Commands robot 0 at each `step`, and gives `checks` the intervals in which it must stand still or drive."""

    def __init__(self, bus: Bus, checks: DriveChecks, rng: Random) -> None:
        self.sent: Counter[str] = Counter()  # invalid commands, by the reason to reject them
        self._bus = bus
        self._raw = lcm.LCM(bus.url)
        self._checks = checks
        self._rng = rng
        # The remaining (time, step) of the current event, the next one last. A driver first needs a zero command.
        self._steps = [(now_utime() + 4 * US_PER_S, "drive")]
        self._due = now_utime() + 5 * US_PER_S
        self._mode = "zero"
        self._last_command = 0
        self._stopped = 0
        self._estop_due = 0

    def step(self, *, with_invalid: bool) -> None:
        """Send the messages that are due, and sometimes an invalid command."""
        now = now_utime()
        if not self._steps and now >= self._due:
            self._plan_event(now)
        while self._steps and now >= self._steps[-1][0]:
            self._next_step(self._steps.pop()[1])
        if self._mode in ("estop", "estop and zero") and now >= self._estop_due:
            self._estop(True)
            self._estop_due = now + US_PER_S // 20
        if self._mode == "drive":
            phase = 2.0 * math.pi * now / US_PER_S
            direction = 1.0 if math.sin(phase / 25.0) >= 0.0 else -1.0
            self._command(direction * (0.5 + 0.3 * math.sin(phase / 7.0)), 0.5 + 0.3 * math.cos(phase / 11.0))
        elif self._mode in ("estop", "released"):
            self._command(0.7, 0.7)
        elif self._mode in ("estop and zero", "zero"):
            self._command(0.0, 0.0)
        if with_invalid and self._rng.random() < INVALID_SHARE:
            self._send_invalid()

    def asked_for_zero(self, utime: int) -> None:
        """Command zero, then drive on, as a person does when the driver reports that it waits for a zero command."""
        self._checks.held.append(utime)
        if self._mode == "drive" and not self._steps:
            self._mode = "zero"
            self._steps = [(now_utime() + 3 * US_PER_S // 10, "drive")]

    def _plan_event(self, now: int) -> None:
        """Plan the next event: an emergency stop or a pause."""
        rng = self._rng

        def after(*what: tuple[float, str]) -> list[tuple[int, str]]:
            steps, moment = [], now
            for seconds, name in what:
                moment += round(seconds * US_PER_S)
                steps.append((moment, name))
            return steps[::-1]

        if rng.random() < 0.6:
            held = rng.choice(("estop", "estop and zero"))
            self._steps = after(
                (0.0, held),
                (rng.uniform(0.6, 3.0), "released"),
                (rng.uniform(0.1, 1.5), "zero"),
                (0.3, "drive"),
                (0.0, "end"),
            )
        else:
            self._steps = after((0.0, "silent"), (rng.uniform(0.6, 2.5), "drive"), (0.0, "end"))

    def _next_step(self, name: str) -> None:
        """Begin the next step of the event."""
        now = now_utime()
        if name == "end":
            self._due = now + round(self._rng.uniform(*REST) * US_PER_S)
            return
        if name in ("estop", "estop and zero"):
            self._estop(True)
            self._stopped, self._estop_due = now_utime(), now + US_PER_S // 20
        elif name == "released":
            self._estop(False)
        elif name == "silent":
            self._stopped = self._last_command
        if name == "zero":
            self._must_be_still(now, "an emergency stop")
        elif name == "drive":
            if self._mode == "silent":
                self._must_be_still(now, "the last command", patient=True)
            self._checks.intervals.append(Interval(now, now + DRIVES_WITHIN, False, f"after {self._mode}"))
        self._mode = name

    def _must_be_still(self, until: int, why: str, *, patient: bool = False) -> None:
        begin = self._stopped + STOP_WITHIN
        if begin < until:
            self._checks.intervals.append(Interval(begin, until, True, why, self._stopped, patient))

    def _estop(self, engaged: bool) -> None:
        message = make(estop_t, utime=now_utime(), engaged=engaged, source="soak", reason="a soak")
        self._bus.publish(ESTOP, message)

    def _command(self, left: float, right: float) -> None:
        self._last_command = now_utime()
        self._send(self._last_command, 0, left, right)

    def _send(self, utime: int, robot_id: int, left: float, right: float) -> None:
        message = make(motor_command_t, utime=utime, robot_id=robot_id, left=left, right=right)
        self._bus.publish(MOTOR_COMMAND, message, 0)

    def _send_invalid(self) -> None:
        """Send a random invalid command, which must not move the motors."""
        now, duty = now_utime(), INVALID_DUTY
        kind = self._rng.choice(("nan", "infinite", "out_of_range", "old", "future", "wrong_robot", "undecodable"))
        if kind == "nan":
            self._send(now, 0, math.nan, duty)
        elif kind == "infinite":
            self._send(now, 0, duty, -math.inf)
        elif kind == "out_of_range":
            self._send(now, 0, duty, 1.0001)
        elif kind == "old":
            self._send(now - self._rng.randrange(US_PER_S, HOUR), 0, duty, duty)
        elif kind == "future":
            self._send(now + self._rng.randrange(US_PER_S, HOUR), 0, duty, duty)
        elif kind == "wrong_robot":
            self._send(now, 7, duty, duty)
        else:
            self._raw.publish(MOTOR_COMMAND.channel(0), self._rng.randbytes(self._rng.randrange(1, 60)))
        self.sent[{"nan": "not_finite", "infinite": "not_finite"}.get(kind, kind)] += 1
