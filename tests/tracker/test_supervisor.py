"""Which poses are believed: steps, pauses, and robots that may have been confused while nobody saw them."""

import math

import pytest

from cmr.bus.messages import make
from cmr.msg import gyro_t, motor_feedback_t
from cmr.tracker.frames import Planar
from cmr.tracker.profile import Carried, Profile, Tracker
from cmr.tracker.supervisor import Supervisor

RATE = 100
BEGIN = 1.7e9  # s
Place = tuple[float, float, float]


class Drive:
    """Robots 0 and 1 that turn on the spot in opposite senses, half a metre apart, and a supervisor that sees them."""

    def __init__(self, wheel_radius: float | None = None) -> None:
        robots = {0: Carried("a", wheel_radius=wheel_radius), 1: Carried("b", wheel_radius=wheel_radius)}
        self.supervisor = Supervisor(Profile(Tracker("vrpn", "x"), robots))
        self.k = 0

    @property
    def t(self) -> float:
        return BEGIN + self.k / RATE

    def place(self, robot_id: int) -> Place:
        noise = 1e-5 * (self.k % 7)
        return 0.5 * robot_id + noise, 0.0, (1.0 - 2.0 * robot_id) * 0.8 * self.k / RATE

    def see(self, seconds: float, places: "dict[int, int] | None" = None, *, gyros: bool = False) -> dict[int, int]:
        """See robots for some time, by default all; `places` says which body shows which robot. Count what passes."""
        passed = {0: 0, 1: 0}
        for _ in range(round(seconds * RATE)):
            self.k += 1
            bodies = {0: 0, 1: 1} if places is None else places
            poses = [Planar(label, *self.place(robot_id)) for label, robot_id in bodies.items()]
            for planar in self.supervisor.take(self.t, poses, {}):
                passed[planar.robot_id] += 1
            for robot_id in (0, 1) if gyros else ():
                utime = round(self.t * 1e6)
                rate = (1.0 - 2.0 * robot_id) * 0.8
                message = make(gyro_t, utime=utime, robot_id=robot_id, yaw_rate=rate, valid=True, received_utime=utime)
                self.supervisor.handle(utime, "", message)
        return passed

    def why(self, robot_id: int) -> str:
        return next((one.why for one in self.supervisor.troubles(self.t) if one.robot_id == robot_id), "")


def test_poses_count_after_a_short_while() -> None:
    drive = Drive()
    assert drive.see(0.4) == {0: 0, 1: 0}
    assert drive.why(0) == "new"
    drive.see(0.2)
    assert drive.see(1.0) == {0: 100, 1: 100}


def test_after_a_pause_in_which_nobody_can_have_taken_its_place_a_robot_is_back_within_a_fifth_of_a_second() -> None:
    drive = Drive()
    drive.see(1.0)
    assert drive.see(1.0, {1: 1}) == {0: 0, 1: 100}
    assert drive.why(0) == "lost"
    assert drive.see(0.2)[0] >= 5
    assert drive.see(1.0) == {0: 100, 1: 100}


def test_robots_that_both_were_unseen_and_may_have_been_swapped_wait_and_say_so() -> None:
    drive = Drive()
    drive.see(1.0)
    drive.see(3.0, {})
    assert drive.see(3.0) == {0: 0, 1: 0}
    assert "may have been confused with robot 1" in drive.why(0)
    assert drive.supervisor.in_doubt() == {0, 1}


def test_gyros_decide_which_robot_is_which() -> None:
    drive = Drive()
    drive.see(1.0)
    drive.see(3.0, {}, gyros=True)
    passed = drive.see(1.0, gyros=True)
    assert min(passed.values()) > 20
    assert drive.supervisor.in_doubt() == set()


def test_gyros_find_robots_that_were_swapped_while_unseen() -> None:
    drive = Drive()
    drive.see(1.0)
    drive.see(3.0, {}, gyros=True)
    assert drive.see(3.0, {0: 1, 1: 0}, gyros=True) == {0: 0, 1: 0}
    assert "not this robot by its wheels" in drive.why(0)


def test_a_visible_swap_is_followed_until_it_is_undone() -> None:
    drive = Drive()
    drive.see(1.0)
    assert drive.see(5.0, {0: 1, 1: 0}) == {0: 0, 1: 0}
    assert drive.why(0) == "in the place of robot 1"
    passed = drive.see(0.3)
    assert min(passed.values()) >= 15


def test_a_body_that_has_jumped_is_never_believed_however_long_it_stays() -> None:
    supervisor = Supervisor(Profile(Tracker("vrpn", "x"), {0: Carried("a")}))
    passed = 0
    for k in range(3000):
        x = 1e-5 * (k % 7) + (0.4 if k >= 200 else 0.0)
        passed += len(supervisor.take(BEGIN + k / RATE, [Planar(0, x, 0.0, 0.0)], {}))
        if k == 199:
            assert passed > 100
            passed = 0
    assert passed == 0
    (trouble,) = supervisor.troubles(BEGIN + 30.0)
    assert trouble.why == "jumped by 0.40 m, 0 degrees"
    assert trouble.seconds == pytest.approx(28.0, abs=0.1)


def test_poses_that_come_again_or_late_are_not_published_twice() -> None:
    drive = Drive()
    drive.see(1.0)
    pose = Planar(0, *drive.place(0))
    assert drive.supervisor.take(drive.t, [pose], {}) == []
    assert drive.supervisor.take(drive.t - 0.02, [pose._replace(x=0.001)], {}) == []
    assert drive.see(1.0) == {0: 100, 1: 100}


def test_wheels_decide_where_there_is_no_gyro() -> None:
    supervisor = Supervisor(Profile(Tracker("vrpn", "x"), {k: Carried(f"b{k}", wheel_radius=0.05) for k in (0, 1)}))
    speeds, came = {0: 0.3, 1: -0.3}, {0: 0, 1: 0}
    for k in range(700):
        t = BEGIN + k / RATE
        poses = [Planar(one, speeds[one] * k / RATE + 1e-5 * (k % 7), 0.5 * one, 0.0) for one in (0, 1)]
        seen = poses if k < 100 or k >= 400 else []
        for planar in supervisor.take(t, seen, {}):
            came[planar.robot_id] += k >= 400
        for one in (0, 1):
            supervisor.handle(round(t * 1e6), "", feedback(round(t * 1e6), one, speeds[one] / 0.05))
    assert min(came.values()) > 100


def feedback(utime: int, robot_id: int, psi: float) -> motor_feedback_t:
    unknown = dict.fromkeys(
        ("applied_left", "applied_right", "current_left", "current_right", "battery_voltage", "temperature"), math.nan
    )
    message = motor_feedback_t()
    message.utime, message.robot_id, message.psi_left, message.psi_right = utime, robot_id, psi, psi
    for name, value in unknown.items():
        setattr(message, name, value)
    return message
