"""Who drives the robot in a soak: steady commands, pauses, emergency stops, and rubbish among them."""

import math
from collections import Counter
from random import Random

import lcm

from cmr.bus.bus import Bus
from cmr.bus.messages import make, now_utime
from cmr.bus.streams import ESTOP, MOTOR_COMMAND
from cmr.msg import estop_t, motor_command_t
from soaking.checks import SECOND, STOP_WITHIN, DriveChecks, Interval

LARGEST_DUTY = 0.8
INSANE_DUTY = 0.95  # in range, but commanded only by messages that must not be taken
REST = (3.0, 12.0)  # s between two events
DRIVES_WITHIN = 2 * SECOND  # us after it may drive again
RUBBISH_SHARE = 0.05  # of commands that have rubbish beside them
HOUR = 3_600 * SECOND


class Pilot:
    """Commands robot 0 at each `turn`; informs `checks` when the motors must stand still and when they must drive."""

    def __init__(self, bus: Bus, checks: DriveChecks, chance: Random) -> None:
        self.sent: Counter[str] = Counter()  # rubbish by the reason for which it must not be taken
        self._bus = bus
        self._raw = lcm.LCM(bus.url)
        self._checks = checks
        self._chance = chance
        # (time, what) still to come of the event at work, the next one last. A driver has to hear zero first.
        self._steps = [(now_utime() + 4 * SECOND, "drive")]
        self._due = now_utime() + 5 * SECOND
        self._mode = "zero"
        self._last_command = 0
        self._stopped = 0
        self._estop_due = 0

    def turn(self, *, rubbish: bool) -> None:
        """Send what is due now, now and then with rubbish beside it."""
        now = now_utime()
        if not self._steps and now >= self._due:
            self._begin(now)
        while self._steps and now >= self._steps[-1][0]:
            self._change(self._steps.pop()[1])
        if self._mode in ("estop", "estop and zero") and now >= self._estop_due:
            self._estop(True)
            self._estop_due = now + SECOND // 20
        if self._mode == "drive":
            phase = 2.0 * math.pi * now / SECOND
            direction = 1.0 if math.sin(phase / 25.0) >= 0.0 else -1.0
            self._command(direction * (0.5 + 0.3 * math.sin(phase / 7.0)), 0.5 + 0.3 * math.cos(phase / 11.0))
        elif self._mode in ("estop", "released"):
            self._command(0.7, 0.7)
        elif self._mode in ("estop and zero", "zero"):
            self._command(0.0, 0.0)
        if rubbish and self._chance.random() < RUBBISH_SHARE:
            self._rubbish()

    def asked_for_zero(self, utime: int) -> None:
        """Do what a person does when the driver says that it waits for zero: command it, then drive on."""
        self._checks.held.append(utime)
        if self._mode == "drive" and not self._steps:
            self._mode = "zero"
            self._steps = [(now_utime() + 3 * SECOND // 10, "drive")]

    def _begin(self, now: int) -> None:
        """Plan what happens next."""
        chance = self._chance

        def after(*what: tuple[float, str]) -> list[tuple[int, str]]:
            steps, moment = [], now
            for seconds, name in what:
                moment += round(seconds * SECOND)
                steps.append((moment, name))
            return steps[::-1]

        if chance.random() < 0.6:
            held = chance.choice(("estop", "estop and zero"))
            self._steps = after(
                (0.0, held),
                (chance.uniform(0.6, 3.0), "released"),
                (chance.uniform(0.1, 1.5), "zero"),
                (0.3, "drive"),
                (0.0, "end"),
            )
        else:
            self._steps = after((0.0, "silent"), (chance.uniform(0.6, 2.5), "drive"), (0.0, "end"))

    def _change(self, name: str) -> None:
        """Go on to the next part of what was planned."""
        now = now_utime()
        if name == "end":
            self._due = now + round(self._chance.uniform(*REST) * SECOND)
            return
        if name in ("estop", "estop and zero"):
            self._estop(True)
            self._stopped, self._estop_due = now_utime(), now + SECOND // 20
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

    def _rubbish(self) -> None:
        """Send something that must move nothing; it is decided before the next command, and after the last."""
        now, duty = now_utime(), INSANE_DUTY
        kind = self._chance.choice(("nan", "infinite", "out_of_range", "old", "future", "wrong_robot", "undecodable"))
        if kind == "nan":
            self._send(now, 0, math.nan, duty)
        elif kind == "infinite":
            self._send(now, 0, duty, -math.inf)
        elif kind == "out_of_range":
            self._send(now, 0, duty, 1.0001)
        elif kind == "old":
            self._send(now - self._chance.randrange(SECOND, HOUR), 0, duty, duty)
        elif kind == "future":
            self._send(now + self._chance.randrange(SECOND, HOUR), 0, duty, duty)
        elif kind == "wrong_robot":
            self._send(now, 7, duty, duty)
        else:
            self._raw.publish(MOTOR_COMMAND.channel(0), self._chance.randbytes(self._chance.randrange(1, 60)))
        self.sent[{"nan": "not_finite", "infinite": "not_finite"}.get(kind, kind)] += 1
