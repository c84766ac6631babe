"""Supervise all robots of a tracker: which poses are accepted, which robots may be swapped, and what to report."""

import math
import re
from collections import Counter
from collections.abc import Iterable, Mapping
from typing import NamedTuple

from cmr.bus.message import Message
from cmr.tracker.frames import Planar
from cmr.tracker.profile import Profile
from cmr.tracker.track import NEVER, NOISE, PAUSE, Pose, Segment, Track
from cmr.tracker.wheels import Identity

LOST = 0.2  # s without a pose after which a robot is reported as lost
MAY_BE = 16.0  # difference in -2 log likelihood below which two assignments of bodies are ambiguous
DRIFT, DRIFT_TURN = 0.3, 2.0  # m/s^2, rad/s^2: standard deviations of the acceleration of unseen robots
SIGMA, SIGMA_TURN = 0.02, 0.06  # m, rad; standard deviations of the initial pose of an unseen robot
ANY_HEADING = math.pi / math.sqrt(3.0)  # rad; standard deviation of a heading that can be any
ASK_AGAIN = 0.05  # s between two checks whether robots can be distinguished
DETAIL = re.compile(" by | with ")  # the rest of a reason is ignored for counting


class Trouble(NamedTuple):
    """The problem with a robot's poses, and for how long [s] it has had none."""

    robot_id: int
    why: str
    seconds: float | None


class Supervisor:
    """Passes on the poses that are reliable. Times are in s, of the host's clock at the exposure."""

    def __init__(self, profile: Profile) -> None:
        self.withheld: Counter[str] = Counter()  # poses, by the reason for withholding them
        is_mock = profile.tracker.type == "mock"  # whose bodies never move
        self._tracks = {robot_id: Track(robot_id, profile.limits, may_repeat=is_mock) for robot_id in profile.robots}
        self._identity = Identity(dict(profile.robots))
        self._doubts: dict[int, _Doubt] = {}
        self._wrong: Mapping[int, str] = {}
        self.was_silent = False
        self._newest = -math.inf

    def handle(self, utime: int, _channel: str, message: Message) -> None:
        """Process a message of a robot's wheels or gyro."""
        self._identity.handle(utime / 1e6, message)

    def begin_anew(self) -> None:
        """Discard the recent history, as the tracker's clock was set."""
        self._doubts.clear()
        self._newest = -math.inf
        for track in self._tracks.values():
            track.forget()

    def take(self, t: float, poses: Iterable[Planar], wrong: Mapping[int, str]) -> list[Planar]:
        """Return the reliable poses of a sample; `wrong` gives the robots without a valid pose, and the reason."""
        self._wrong = wrong
        if t > self._newest:
            self.was_silent, self._newest = t - self._newest > PAUSE, t
        passed = []
        for planar in poses:
            track = self._tracks[planar.robot_id]
            pose = Pose(t, planar.x, planar.y, planar.theta)
            if track.take(pose, self):
                passed.append(planar)
            elif track.has_lasted and not track.frozen and track.seen == t and self._is_clear(track):
                track.believe()
                passed.append(planar)
            else:
                self.withheld[DETAIL.split(self._why(track) or "late")[0]] += 1
        return passed

    def in_doubt(self) -> set[int]:
        """Return the robots that may have been swapped with others, and those others."""
        doubted = [track for track in self._tracks.values() if self._doubt_of(track) is not None]
        return {one for track in doubted for one in (track.robot_id, *self._doubts[track.robot_id].others)}

    def troubles(self, now: float) -> list[Trouble]:
        """Return the robots without poses, and why."""
        found = []
        for robot_id, track in self._tracks.items():
            since = None if track.believed is None else now - track.believed.t
            why = self._why(track)
            if now - track.seen > LOST and not track.frozen:
                why = self._wrong.get(robot_id) or ("lost" if math.isfinite(track.seen) else "not seen yet")
            if why and (since is None or since > LOST):
                found.append(Trouble(robot_id, why, since))
        return found

    def _why(self, track: Track) -> str:
        doubt = self._doubt_of(track)
        return doubt.words if doubt is not None else track.why

    def _doubt_of(self, track: Track) -> "_Doubt | None":
        """Return the other robots that a reappeared one may be; None if it has not reappeared, or is unambiguous."""
        doubt = self._doubts.get(track.robot_id)
        return doubt if doubt is not None and doubt.others and doubt.segment is track.segment else None

    def in_place_of(self, track: Track, pose: Pose) -> int | None:
        """Return the robot at whose expected position a body with another one's name is."""
        for other in self._tracks.values():
            expected = other.expected(pose.t)
            if other is track or expected is None or other.believed is None or pose.t - other.believed.t > 2.0 * PAUSE:
                continue
            if math.hypot(pose.x - expected.x, pose.y - expected.y) <= 5.0 * NOISE:
                return other.robot_id
        return None

    def is_freed(self, track: Track, pose: Pose) -> bool:
        """Return whether a pose continues the course that another body showed while it had this robot's identity."""
        for other in self._tracks.values():
            for segment in (other.segment, other.before):
                if segment is None or segment.of != track.robot_id or other is track:
                    continue
                if pose.t - segment.last.t <= PAUSE and track.is_possible(pose, segment.last, 3.0):
                    return True
        return False

    def _is_clear(self, track: Track) -> bool:
        """Return whether a reappeared robot is unambiguous, by its place or by wheels and gyro."""
        segment = track.segment
        assert segment is not None
        doubt = self._doubts.get(track.robot_id)
        if doubt is None or doubt.segment is not segment:
            doubt = self._doubts[track.robot_id] = _Doubt(segment)
        if segment.last.t >= doubt.ask_at:
            doubt.ask_at = segment.last.t + ASK_AGAIN
            doubt.others = [other.robot_id for other in self._tracks.values() if self._may_be(track, other)]
        if doubt.others:
            decided = self._identity.decide(track.robot_id, doubt.others, segment.course)
            if decided is not True:
                doubt.is_another = decided is False
                return False
        self._doubts.pop(track.robot_id)
        return True

    def _may_be(self, track: Track, other: Track) -> bool:
        """Return whether two robots may have been swapped while neither was seen, or one while the other was wrong."""
        segment, believed = track.segment, track.believed
        if other is track or segment is None or believed is None or other.believed is None:
            return False
        if segment.is_course_known:
            return False
        if segment.first.t - other.believed.t <= 2.0 * PAUSE:
            return False  # the other one was seen at its own place
        theirs = other.segment
        if theirs is None or theirs.last.t < segment.first.t - PAUSE:  # the other one has not reappeared
            is_likely = _misfit(other, segment.first) - _misfit(track, segment.first) < MAY_BE
            return is_likely and other.is_possible(segment.first, other.believed)
        if theirs.needed == NEVER and theirs.of is None and not track.is_possible(theirs.first, believed):
            return False
        return self._swapped_is_likely(track, segment, other, theirs)

    def _swapped_is_likely(self, track: Track, segment: Segment, other: Track, theirs: Segment) -> bool:
        own = _misfit(track, segment.first) + _misfit(other, theirs.first)
        swapped = _misfit(track, theirs.first) + _misfit(other, segment.first)
        can_be = track.is_possible(theirs.first, _of(track)) and other.is_possible(segment.first, _of(other))
        return can_be and swapped - own < MAY_BE


class _Doubt:
    """A reappeared robot: its motion since, and the other robots it may be."""

    def __init__(self, segment: Segment) -> None:
        self.segment = segment
        self.others: list[int] = []
        self.is_another = False
        self.ask_at = -math.inf

    @property
    def words(self) -> str:
        names = " or ".join(map(str, self.others[:3])) or "another one"
        if self.is_another:
            return f"not this robot by its wheels, but {names}"
        return f"may have been confused with robot {names} while unseen; turning one of them shows which it is"


def _of(track: Track) -> Pose:
    assert track.believed is not None
    return track.believed


def _misfit(track: Track, pose: Pose) -> float:
    """Return -2 log density of the poses of a robot last seen a while ago, up to a constant."""
    believed = _of(track)
    dt = max(pose.t - believed.t, 0.0)
    sigma = SIGMA + DRIFT * dt * dt / 2.0
    sigma_turn = min(SIGMA_TURN + DRIFT_TURN * dt * dt / 2.0, ANY_HEADING)
    coasting = min(dt, 0.5)
    expected = track.expected(believed.t + coasting)
    assert expected is not None
    distance = math.hypot(pose.x - expected.x, pose.y - expected.y)
    turn = math.remainder(pose.theta - expected.theta, 2.0 * math.pi)
    spread = 4.0 * math.log(sigma) + 2.0 * math.log(sigma_turn)
    return (distance / sigma) ** 2 + (turn / sigma_turn) ** 2 + spread
