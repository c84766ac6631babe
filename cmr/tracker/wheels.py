"""Motion of robots by wheels and gyro, to distinguish robots that a tracker may have swapped."""

import math
from collections import deque

from cmr.bus.message import Message
from cmr.msg import gyro_t, motor_feedback_t
from cmr.tracker.profile import Carried
from cmr.tracker.track import LONGEST_COURSE, Course, Pose

KEPT = LONGEST_COURSE + 0.5  # s of readings
GAP = 0.2  # s between two readings, beyond which the motion between them is unknown
TURN_AGREES, TURN_DIFFERS = 0.06, 0.15  # rad between a tracked turn and that of the gyro
WAY_AGREES, WAY_DIFFERS = 0.05, 0.15  # m between a tracked way and that of the wheels
LEAST = 0.1  # s of movement to compare


class Wheels:
    """The turn [rad] and the way [m] that one robot says it has made, added up."""

    def __init__(self, wheel_radius: float | None) -> None:
        self._radius = wheel_radius
        self._turns: deque[tuple[float, float]] = deque()
        self._ways: deque[tuple[float, float]] = deque()

    def handle(self, t: float, message: Message) -> None:
        """The turn [rad] and the distance [m] of one robot by its own sensors, integrated."""
        if isinstance(message, gyro_t) and message.valid:
            _add(self._turns, t, message.yaw_rate)
        elif isinstance(message, motor_feedback_t) and self._radius is not None:
            _add(self._ways, t, self._radius * (message.psi_left + message.psi_right) / 2.0)

    def agrees(self, begin: Pose, end: Pose, way: float) -> bool | None:
        """Return whether these readings are consistent with this course; None if that is undecided.

        `way` [m] is the distance along its heading from the begin to the end.
        """
        turned, driven = _between(self._turns, begin.t, end.t), _between(self._ways, begin.t, end.t)
        answers = []
        if turned is not None:
            answers.append(
                _answer(abs(turned - math.remainder(end.theta - begin.theta, 2 * math.pi)), TURN_AGREES, TURN_DIFFERS)
            )
        if driven is not None:
            answers.append(_answer(abs(driven - way), WAY_AGREES, WAY_DIFFERS))
        if False in answers:
            return False
        return True if True in answers else None


class Identity:
    """Decides by wheels and gyro which of several robots a body is."""

    def __init__(self, robots: dict[int, Carried]) -> None:
        self._wheels = {robot_id: Wheels(carried.wheel_radius) for robot_id, carried in robots.items()}

    def handle(self, t: float, message: Message) -> None:
        """Process a message of a robot."""
        if isinstance(message, gyro_t | motor_feedback_t):
            wheels = self._wheels.get(message.robot_id)
            if wheels is not None:
                wheels.handle(t, message)

    def decide(self, robot_id: int, others: list[int], course: Course) -> bool | None:
        """Return whether a body with this course is this robot, and none of the others; None while that is undecided.

        The robot's own wheels have to agree, and those of each other one have to disagree.
        """
        begin, end = course.begin, course.end
        if end.t - begin.t < LEAST:
            return None
        answers = [self._wheels[one].agrees(begin, end, course.way) for one in [robot_id, *others]]
        if answers[0] is False:
            return False
        return True if answers[0] and all(answer is False for answer in answers[1:]) else None


def _answer(difference: float, agrees: float, differs: float) -> bool | None:
    """Return whether numbers agree; None between the two bounds."""
    return True if difference <= agrees else False if difference >= differs else None


def _add(total: deque[tuple[float, float]], t: float, rate: float) -> None:
    """Integrate a rate; the total before a gap is discarded."""
    if total and not 0.0 < t - total[-1][0] <= GAP:
        total.clear()
    before, value = total[-1] if total else (t, 0.0)
    total.append((t, value + rate * (t - before)))
    while total[0][0] < t - KEPT:
        total.popleft()


def _between(total: deque[tuple[float, float]], begin: float, end: float) -> float | None:
    """Return by how much a total has grown between two times; None if it does not cover them."""
    if not total or total[0][0] > begin or total[-1][0] < end - GAP:
        return None
    return _at(total, end) - _at(total, begin)


def _at(total: deque[tuple[float, float]], t: float) -> float:
    """Return a total at a time, interpolated between its readings."""
    after = next((k for k, (time, _) in enumerate(total) if time >= t), len(total) - 1)
    (t0, v0), (t1, v1) = total[max(after - 1, 0)], total[after]
    return v0 + (v1 - v0) * min(max((t - t0) / (t1 - t0), 0.0), 1.0) if t1 > t0 else v1
