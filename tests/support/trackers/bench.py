"""An emulated tracker and cmr.tracker in lockstep, over the loopback but in simulated time, with scores."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cmr.bus.messages import make
from cmr.msg import gyro_t
from cmr.tracker.opening import open_source
from cmr.tracker.profile import Carried, Limits, Profile, Tracker
from cmr.tracker.tracking import Placed, Tracking
from tests.support.trackers.frame import Body, Emitted
from tests.support.trackers.motion import Fault, Robots, measured
from tests.support.trackers.natnet_server import NatNetServer
from tests.support.trackers.qtm_server import QtmServer
from tests.support.trackers.vrpn_server import VrpnServer

RATE = 240.0  # Hz
DAY = 1_700_000_000.0  # s; the time of the day when the simulated clock is 0
BEGIN = 1000.0  # s of the simulated clock
STAMP_OFFSET, STAMP_DRIFT = -321.5, 30e-6  # of the tracker's own clock: s, s/s
PROCESSING, WAY, JITTER = 0.004, 0.0002, 0.0001  # s from the exposure to sending, and to the arrival
WRONG_PLACE, WRONG_TURN = 0.02, math.radians(5.0)
STARTED = 1.5  # s after which good poses that are withheld count
LOOK_PERIOD = 0.02  # s
FRACTION_BUSY, BUSY = 0.02, 0.003  # how often this computer is held up, and for how long on average [s]

Flags = NDArray[np.bool_]
Server = NatNetServer | QtmServer | VrpnServer
KINDS = ("optitrack", "qualisys", "vrpn")


@dataclass
class Score:
    """What came of a run. Times are in s."""

    published: int = 0
    wrong: int = 0
    good: int = 0
    withheld: int = 0
    stamp_errors: list[float] = field(default_factory=list)
    recovery: float = 0.0  # the latest a robot has poses again after the misbehaviour
    reported_after: float | None = None  # from the last frame to the report that there are none
    reports: list[str] = field(default_factory=list)

    @property
    def share_withheld(self) -> float:
        """The share of good poses that were not published."""
        return self.withheld / max(self.good, 1)


class Bench:
    """A tracker of a kind, with robots that are tracked among its bodies."""

    def __init__(
        self,
        kind: str,
        *,
        bodies: int = 50,
        robots: int | None = None,
        rate: float = RATE,
        seed: int = 0,
        has_gyros: bool = True,
    ) -> None:
        self.has_gyros = has_gyros
        self.now = BEGIN
        self.rate, self.kind = rate, kind
        self.robots = Robots(bodies, seed)
        self.random = np.random.default_rng(seed)
        self.server = server_of(kind)
        self.second: NatNetServer | None = None
        lag = 0.0 if kind == "optitrack" else PROCESSING + WAY  # only NatNet tells when a frame was sent
        tracker = Tracker(kind, "127.0.0.1", "127.0.0.1", port=self.server.port, lag=lag)
        tracked = {k: Carried(f"robot_{k}") for k in range(robots if robots is not None else bodies)}
        self.profile = Profile(tracker, tracked, Limits())
        self.tracking = Tracking(self.profile, open_source(tracker, self.clock), self.clock, self.day)
        self.placed: list[Placed] = []
        self.publish: Callable[[Placed], object] = lambda _: None
        self.spent: list[float] = []  # s of a core for each frame, from its arrival to the last pose on the bus
        self._looked = 0.0
        self.reports: list[tuple[float, str]] = []

    def clock(self) -> int:
        """Return the simulated monotonic time [ns]."""
        return round(self.now * 1e9)

    def day(self) -> int:
        """Return the simulated time of the day [ns]."""
        return round((self.now + DAY) * 1e9)

    def close(self) -> None:
        """Close all sockets."""
        self.tracking.source.close()
        self.server.close()
        if self.second is not None:
            self.second.close()

    def connect(self) -> None:
        """Let the source find the server, and learn the bodies' names."""
        for _ in range(400):
            self.server.names = [f"robot_{k}" for k in range(self.robots.count)]
            self.tracking.wait(0.002)
            self.server.poll()
            self.tracking.read()
            self.now += 0.02
            if self._is_ready():
                return
        raise TimeoutError(f"no connection to the emulated {self.kind}")

    def _is_ready(self) -> bool:
        if isinstance(self.server, NatNetServer):
            return not self.tracking.source.problem and bool(self.server.clients) and self.now > BEGIN + 3.0
        return bool(self.server.clients) and self.now > BEGIN + 1.0

    def run(self, seconds: float, fault: Fault | None = None) -> Score:
        """Run for some seconds, and score what was published."""
        frames = int(seconds * self.rate)
        begin = self.now
        right: list[Flags] = []
        held_back: list[tuple[float, Emitted]] = []
        for k in range(frames):
            t = k / self.rate
            exposed = begin + t
            bodies = measured(self.robots, exposed, self.random)
            is_on = fault is not None and fault.is_on(t)
            wrong = fault.change(bodies, t, self.random) if is_on and fault and fault.change else bodies
            right.append(self._are_right(wrong, exposed))
            if is_on and fault and fault.silent:
                right[-1][:] = False
                self.now = exposed
                self._look()
                continue
            frame = self._frame(k, exposed, wrong)
            if is_on and fault and fault.shuffled and self.random.random() < 0.1:
                held_back.append((exposed + self.random.uniform(1.0, 4.0) / self.rate, frame))
                right[-1][:] = False
                continue
            self._deliver(exposed + PROCESSING + self._delay(), frame)
            for due, late in [one for one in held_back if one[0] <= exposed]:
                held_back.remove((due, late))
                self._deliver(self.now, late)
            if is_on and fault and fault.second:
                self._deliver_second(k, exposed, fault.second(wrong))
            self._look()
        return self._score(begin, right, fault)

    def send(self, number: int, exposed: float, bodies: list[Body]) -> None:
        """Send a frame of these bodies, and take its poses."""
        self._deliver(exposed + PROCESSING + self._delay(), self._frame(number, exposed, bodies))

    def _delay(self) -> float:
        """Return how long a frame is on its way, and this computer busy with something else [s]."""
        delay = WAY + self.random.exponential(JITTER)
        return delay + self.random.exponential(BUSY) if self.random.random() < FRACTION_BUSY else delay

    def _frame(self, number: int, exposed: float, bodies: list[Body]) -> Emitted:
        return Emitted(number, self._theirs(exposed), self._theirs(exposed + PROCESSING), bodies)

    def _theirs(self, t: float) -> float:
        return t + STAMP_OFFSET + BEGIN + STAMP_DRIFT * (t - BEGIN)

    def _deliver(self, arrival: float, frame: Emitted) -> None:
        self.now = max(self.now, arrival)
        self.server.send(frame)
        self._take(sum(body.tracked for body in frame.bodies))

    def _take(self, bodies: int) -> None:
        """Take what was sent: VRPN's poses may come in parts."""
        seen, spent = 0, 0.0
        while seen < bodies and self.tracking.wait(0.2):
            began, before = time.process_time(), self.tracking.bodies_seen
            came = self.tracking.read()
            for placed in came:
                self.publish(placed)
            spent += time.process_time() - began
            self.placed += came
            seen += self.tracking.bodies_seen - before
            if isinstance(self.server, NatNetServer):
                break
        self.spent.append(spent)

    def _deliver_second(self, number: int, exposed: float, bodies: list[Body]) -> None:
        """Let a second tracker send: NatNet's from a port of its own, others' through the same server."""
        between = exposed + 0.5 / self.rate
        frame = self._frame(number, between, bodies)
        self.now = max(self.now, between + PROCESSING + self._delay())
        if not isinstance(self.server, NatNetServer):
            self.server.send(frame)
        else:
            self.second = self.second or NatNetServer()
            self.second.clients = self.server.clients
            self.second.send(frame)
        self._take(len(bodies))

    def _look(self) -> None:
        """Let time pass without a frame: gyros report, and the status is looked at, each 20 ms."""
        if self.now - self._looked < LOOK_PERIOD:
            return
        self._looked = self.now
        self.tracking.wait(0.0)
        before, after = self.robots.all_at(self.now - 0.001)[2], self.robots.all_at(self.now + 0.001)[2]
        rates = ((after - before + math.pi) % (2.0 * math.pi) - math.pi) / 0.002
        utime = self.day() // 1000
        for number in self.profile.robots if self.has_gyros else ():
            rate = float(rates[number])
            message = make(gyro_t, utime=utime, robot_id=number, yaw_rate=rate, valid=True, received_utime=utime)
            self.tracking.supervisor.handle(utime, f"GYRO_{number}", message)
        self.reports.append((self.now, self.tracking.problem(self.now)))

    def _are_right(self, bodies: list[Body], t: float) -> Flags:
        """Return which bodies are tracked, and where their robots are."""
        sent = np.array([[body.x, body.y, body.theta] for body in bodies]).T
        return np.array([body.tracked for body in bodies]) & ~_are_wrong(sent, self.robots.all_at(t))

    def _score(self, begin: float, right: list[Flags], fault: Fault | None) -> Score:
        score = Score(published=len(self.placed))
        came = np.zeros((len(right) + 1, self.robots.count), bool)
        first_after: dict[int, float] = {}
        for placed in self.placed:
            t = placed.utime / 1e6 - DAY
            truth = np.array(self.robots.at(placed.robot_id, t))
            score.wrong += int(_are_wrong(np.array(placed[2:]), truth))
            frame = round((t - begin) * self.rate)
            score.stamp_errors.append(t - begin - frame / self.rate)
            if 0 <= frame < len(right):
                came[frame, placed.robot_id] = True
            if fault is not None and t - begin >= fault.end:
                first_after.setdefault(placed.robot_id, t - begin - fault.end)
        good = np.array(right)[int(STARTED * self.rate) :, : len(self.profile.robots)]
        here = came[int(STARTED * self.rate) : len(right), : len(self.profile.robots)]
        score.good, score.withheld = int(good.sum()), int((good & ~here).sum())
        if fault is not None:
            score.recovery = max((first_after.get(one, math.inf) for one in self.profile.robots), default=0.0)
        score.reports = sorted({report for _, report in self.reports if report})
        if fault is not None and fault.silent:
            last = begin + fault.begin - 1.0 / self.rate
            said = [t for t, report in self.reports if "No frame" in report and t > last]
            score.reported_after = said[0] - last if said else math.inf
        return score


def server_of(kind: str) -> Server:
    """Return an emulated tracker of a kind."""
    if kind == "optitrack":
        return NatNetServer()
    return QtmServer() if kind == "qualisys" else VrpnServer()


def _are_wrong(poses: NDArray[np.float64], truth: NDArray[np.float64]) -> Flags:
    """Return which poses (3, ...) are further from the truth than a pose may be."""
    (x, y, theta), (true_x, true_y, true_theta) = poses, truth
    turn = np.abs((theta - true_theta + math.pi) % (2.0 * math.pi) - math.pi)
    return np.asarray((np.hypot(x - true_x, y - true_y) > WRONG_PLACE) | (turn > WRONG_TURN))
