"""Track one robot's poses and decide which of them to accept.

Poses are cut into segments wherever a body's motion is impossible for a robot: a step further than its speed allows, a
turn faster than its turn rate, or a pause. A segment is accepted or not as a whole, because tracker errors are like
that: a body that has taken another's identity, or whose markers are confused, moves on smoothly in the wrong place.

- A segment that begins with an impossible step is never believed, however long it lasts.
- After a pause (lost, frozen) a segment is believed when it begins where the robot can have come, and has lasted.
- After a wrong segment the next one is believed soon if it continues the right course: the last believed pose plus the
  movement seen meanwhile, which is right if the body was only displaced, or the course of the body that had taken its
  identity. If it begins only where the robot can have come, it has to last for longer.
"""

import math
from typing import NamedTuple, Protocol

from cmr.tracker.profile import Limits

NOISE, TURN_NOISE = 0.004, math.radians(2.0)  # m, rad between two poses of a body at rest
AT_ONCE = 0.02  # m of error up to which a pose is accepted at once
PAUSE = 0.05  # s without a pose after which the motion meanwhile is unknown
ACCELERATION, TURN_ACCELERATION = 6.0, 25.0  # m/s^2, rad/s^2; of a robot that is not pushed
SMOOTHING = 0.03  # s over which the speed is averaged
PREDICTED, PREDICTED_TURN = 0.006, math.radians(2.5)  # m, rad least error of a predicted pose
# s that a segment must last: after silence, with good evidence, without, and at the start.
BRIEF_RUN, SHORT_RUN, LONG_RUN, FIRST_RUN = 0.03, 0.1, 0.8, 0.5
NEVER = math.inf
CARRIED_ERROR = 0.02  # m of error per m of accumulated motion
FLIPPED = math.radians(150.0)  # rad; a larger instantaneous turn is a flip
LONGEST_COURSE = 2.5  # s of movement that is compared with wheels and gyro
RECENT = 0.5  # s; what follows a wrong segment that ended less than this ago is likely to continue it


class Pose(NamedTuple):
    """A pose [m, rad] at a time [s]."""

    t: float
    x: float
    y: float
    theta: float


class Course:
    """Recent motion of a body: its first and last pose, and the distance [m] travelled along its heading."""

    __slots__ = ("begin", "end", "way")

    def __init__(self, begin: Pose) -> None:
        self.begin = self.end = begin
        self.way = 0.0

    def extend(self, pose: Pose) -> None:
        """Add a pose; a new course begins when it has become long."""
        if pose.t - self.begin.t > LONGEST_COURSE:
            self.begin, self.way = self.end, 0.0
        heading = self.end.theta + math.remainder(pose.theta - self.end.theta, 2.0 * math.pi) / 2.0
        self.way += (pose.x - self.end.x) * math.cos(heading) + (pose.y - self.end.y) * math.sin(heading)
        self.end = pose


class Segment:
    """Poses without a break: the first and the last of them, and how long it has to last to be believed."""

    __slots__ = ("carried", "course", "first", "is_course_known", "last", "needed", "of", "path", "why")

    def __init__(
        self, first: Pose, needed: float, why: str, carried: Pose | None = None, of: int | None = None
    ) -> None:
        self.first = self.last = first
        self.needed, self.why = needed, why
        self.carried = carried  # the last believed pose plus all motion since
        self.is_course_known = False  # the robot was tracked continuously from the last believed pose on
        self.of = of  # the robot at whose place it began: that one has taken this identity
        self.path = 0.0  # m
        self.course = Course(first)

    def extend(self, pose: Pose) -> None:
        """Add a pose."""
        dx, dy, dtheta = pose.x - self.last.x, pose.y - self.last.y, pose.theta - self.last.theta
        if self.carried is not None:
            self.carried = Pose(pose.t, self.carried.x + dx, self.carried.y + dy, self.carried.theta + dtheta)
        self.path += math.hypot(dx, dy)
        self.course.extend(pose)
        self.last = pose


class Company(Protocol):
    """What a track needs to know of the other robots' tracks.

    With `was_silent`, the tracker sent nothing for a while, although it may have seen all bodies throughout.
    """

    was_silent: bool

    def in_place_of(self, track: "Track", pose: Pose) -> int | None:
        """Return the robot at whose expected position a body with another one's name is."""

    def is_freed(self, track: "Track", pose: Pose) -> bool:
        """Return whether a pose continues the course that another body showed while it had this robot's identity."""


class Track:
    """The poses of one robot. `believed` is the last accepted pose; `why` names the problem that exists since
    `wrong_since`.
    """

    def __init__(self, robot_id: int, limits: Limits, *, may_repeat: bool = False) -> None:
        self.robot_id = robot_id
        self._may_repeat = may_repeat
        self.believed: Pose | None = None
        self.velocity = (0.0, 0.0, 0.0)  # m/s, m/s, rad/s when it was believed last
        self.segment: Segment | None = None
        self.before: Segment | None = None  # the segment before, where that one was wrong
        self.is_believed = False
        self.frozen = False
        self.late = 0  # poses out of order
        self.seen = -math.inf  # s; the last fresh pose
        self._limits = limits

    @property
    def why(self) -> str:
        """The problem with current poses; empty if there is none."""
        if self.frozen:
            return "frozen"
        return "" if self.is_believed or self.segment is None else self.segment.why

    @property
    def has_lasted(self) -> bool:
        """Whether its segment was not believed so far, but has lasted long enough."""
        segment = self.segment
        return segment is not None and not self.is_believed and segment.last.t - segment.first.t >= segment.needed

    def is_possible(self, pose: Pose, since: Pose, noises: float = 1.0) -> bool:
        """Return whether a robot can have come from one pose to another, later one."""
        dt = pose.t - since.t
        reach = noises * NOISE + self._limits.speed * dt
        turn = noises * TURN_NOISE + self._limits.turn_rate * dt
        return (
            math.hypot(pose.x - since.x, pose.y - since.y) <= reach
            and abs(math.remainder(pose.theta - since.theta, 2.0 * math.pi)) <= turn
        )

    def expected(self, t: float) -> Pose | None:
        """Return the expected pose at a time, extrapolated from when it was last believed."""
        if self.believed is None:
            return None
        dt = t - self.believed.t
        vx, vy, omega = self.velocity
        return Pose(t, self.believed.x + vx * dt, self.believed.y + vy * dt, self.believed.theta + omega * dt)

    def take(self, pose: Pose, company: Company) -> bool:
        """Process the next pose; return whether it is believed without further evidence."""
        segment = self.segment
        if segment is not None:
            last = segment.last
            if pose.t <= last.t:
                self.late += 1
                return False
            if pose[1:] == last[1:] and not self._may_repeat:
                self.frozen = True
                return False
        self.frozen = False
        self.seen = pose.t
        if self._continues(pose):
            self._believe(pose)
            return True
        self._follow(pose, company)
        return False

    def believe(self) -> None:
        """Believe the segment from now on."""
        assert self.segment is not None
        self.velocity = (0.0, 0.0, 0.0)
        self.believed, self.is_believed, self.before = self.segment.last, True, None
        self.segment = Segment(self.segment.last, 0.0, "")

    def forget(self) -> None:
        """Discard the segment, as the tracker starts again; the last believed pose stays known."""
        self.segment = self.before = None
        self.is_believed = self.frozen = False

    def _continues(self, pose: Pose) -> bool:
        """Return whether a pose surely continues the believed ones, also after a few wrong or missing ones."""
        if self.believed is None:
            return False
        dt = pose.t - self.believed.t
        if not 0.0 < dt <= PAUSE or not self.is_possible(pose, self.believed):
            return False
        if NOISE + self._limits.speed * dt <= AT_ONCE:
            return True
        expected = self.expected(pose.t)
        assert expected is not None
        error = PREDICTED + ACCELERATION * dt * dt / 2.0
        turn_error = PREDICTED_TURN + TURN_ACCELERATION * dt * dt / 2.0
        return (
            math.hypot(pose.x - expected.x, pose.y - expected.y) <= error
            and abs(math.remainder(pose.theta - expected.theta, 2.0 * math.pi)) <= turn_error
        )

    def _believe(self, pose: Pose) -> None:
        believed, segment = self.believed, self.segment
        assert believed is not None
        dt = pose.t - believed.t
        share = dt / (dt + SMOOTHING)
        vx, vy, omega = self.velocity
        turned = math.remainder(pose.theta - believed.theta, 2.0 * math.pi)
        self.velocity = (
            vx + share * ((pose.x - believed.x) / dt - vx),
            vy + share * ((pose.y - believed.y) / dt - vy),
            omega + share * (turned / dt - omega),
        )
        self.believed = pose
        if self.is_believed and segment is not None:
            segment.last = pose
        else:
            self.segment, self.before, self.is_believed = Segment(pose, 0.0, ""), None, True

    def _follow(self, pose: Pose, company: Company) -> None:
        """Continue the segment, or begin another one with this pose."""
        segment = self.segment
        was_believed, self.is_believed = self.is_believed, False
        if segment is None or self.believed is None:
            if segment is not None and self._is_step(pose, segment.last):
                segment.extend(pose)
            else:
                self.segment = Segment(pose, FIRST_RUN, "new")
        elif was_believed and not self._is_step(pose, segment.last):
            self._leave_believed(pose, segment, company)
        elif self._is_step(pose, segment.last) and not was_believed:
            segment.extend(pose)
        else:  # the first pose that is not quite as expected
            self._begin(pose, segment, company)

    def _is_step(self, pose: Pose, last: Pose) -> bool:
        return pose.t - last.t <= PAUSE and self.is_possible(pose, last)

    def _leave_believed(self, pose: Pose, segment: Segment, company: Company) -> None:
        """Begin a segment after believed poses: after a pause, or with a step that is impossible for a robot."""
        assert self.believed is not None
        if pose.t - segment.last.t > PAUSE and self.is_possible(pose, self.believed):
            self.segment = Segment(pose, BRIEF_RUN if company.was_silent else SHORT_RUN, "back")
        else:
            self.segment = self._wrong(pose, self.believed, self.believed, company)
        self.before = None

    def _wrong(self, pose: Pose, since: Pose, carried: Pose | None, company: Company) -> Segment:
        """Return a segment that is not believed, and why."""
        turn = abs(math.remainder(pose.theta - since.theta, 2.0 * math.pi))
        distance = math.hypot(pose.x - since.x, pose.y - since.y)
        other = company.in_place_of(self, pose)
        if other is not None:
            why = f"in the place of robot {other}"
        elif turn >= FLIPPED and distance <= NOISE + self._limits.speed * (pose.t - since.t):
            why = "flipped by 180 degrees"
        else:
            why = f"jumped by {distance:.2f} m, {math.degrees(turn):.0f} degrees"
        return Segment(pose, NEVER, why, _restamped(carried, pose.t), other)

    def _begin(self, pose: Pose, ended: Segment, company: Company) -> None:
        """Begin a segment after one that was not believed."""
        believed = self.believed
        assert believed is not None
        paused = pose.t - ended.last.t > PAUSE
        if ended.carried is not None:
            self.before = ended
        if not self.is_possible(pose, believed):
            self.segment = self._wrong(pose, believed, ended.carried, company)
        elif self.before is None:
            self.segment = Segment(pose, SHORT_RUN, "back")
        elif self._is_as_carried(pose, self.before) or company.is_freed(self, pose):
            self.segment = Segment(pose, SHORT_RUN, "back")
            self.segment.is_course_known = True
        elif paused and pose.t - ended.last.t <= RECENT and self.is_possible(pose, ended.last):
            self.segment = self._wrong(pose, believed, ended.carried, company)
        else:
            self.segment = Segment(pose, LONG_RUN, "back", _restamped(ended.carried, pose.t))

    def _is_as_carried(self, pose: Pose, wrong: Segment) -> bool:
        """Return whether a pose agrees with the motion seen in a wrong segment."""
        carried = wrong.carried
        if carried is None or pose.t - carried.t > PAUSE:
            return False
        dt = pose.t - carried.t
        distance = math.hypot(pose.x - carried.x, pose.y - carried.y)
        turn = abs(math.remainder(pose.theta - carried.theta, 2.0 * math.pi))
        reach = 3.0 * NOISE + CARRIED_ERROR * wrong.path + self._limits.speed * dt
        return distance <= reach and turn <= 3.0 * TURN_NOISE + self._limits.turn_rate * dt


def _restamped(pose: Pose | None, t: float) -> Pose | None:
    """Return a pose with another time; motion during the step between two segments is not observed."""
    return None if pose is None else Pose(t, pose.x, pose.y, pose.theta)
