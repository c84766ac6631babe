"""Check poses against the path by the wheels: frame, units, tracked body, latency.

Poses are modelled as z = a (o + d e) + c with position o and e = exp(i heading) by the wheels, `lateness` before the
stamp, and the tracked point d on the robot; a contains the scale and the orientation of the frame, which does not
matter. In a mirrored frame o and e are conjugate.
"""

import cmath
import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from robot_driver.bringup.bench import CannotTell
from robot_driver.bringup.fitting import Undetermined, least_squares
from robot_driver.bringup.lateness import Lateness, Seen, lateness_of
from robot_driver.bringup.odometry import Path
from robot_driver.bringup.poses_found import UNITS, PosesFound

MOST = 240  # poses used, except for latency
MOST_FOR_LATENESS = 1200
FEWEST = 60
EARLIEST, LATEST, FINEST = -0.1, 0.8, 0.04  # s; range and step of tested latencies
FLAT = 0.1  # ratio of the spreads of two axes below which one does not show the drive
WIDE = 0.2  # ratio required of the drive itself
MOVES = 0.9  # share of the poses' spread explained by the wheels, if they belong to this robot
APART = 3.0  # required ratio of the residuals of mirrored and unmirrored frames
PLACE, ANGLE = 0.02, 0.05  # m, rad: normal differences between wheels and poses
DEGREES = 180.0 / math.pi
HEADING_SHARE = 0.35  # tolerance of rotations by wheels and poses: measured base width
LENGTH_SHARE = 0.045  # tolerance of distances
SMALL_ANGLE, SMALL_POINT = math.radians(4.0), 0.015  # rad, m: smaller offsets are not reported
SMALL_LATENESS = 0.035  # s; slip of accelerating wheels looks like up to 0.03 s
SURE = 4.0  # standard deviations for a significant latency


class Pose(NamedTuple):
    """A pose as received: `time` of its stamp (s, of the drive), `place` as x + iy and `theta` in unknown units."""

    time: float
    place: complex
    theta: float


class _Fit(NamedTuple):
    """A fit of positions: handedness, latency, a, d and the residual (root mean square, m)."""

    mirrored: bool
    lateness: float
    a: complex
    point: complex
    error: float


class _Headings(NamedTuple):
    """The relation of headings to the wheels: shown = unit * slope * heading + unit * begin; `error` in rad."""

    unit: float
    slope: float
    begin: float
    error: float


def judged(path: Path, poses: Sequence[Pose], others: Mapping[int, Sequence[Pose]]) -> PosesFound:
    """Return the properties of this robot's poses; `others` are those of other robots.

    Raises CannotTell.
    """
    all_poses, poses = poses, _thinned(poses)
    if len(poses) < FEWEST and any(len(some) >= FEWEST for some in others.values()):
        raise CannotTell(_whose(path, others))
    if len(poses) < FEWEST:
        raise CannotTell(f"only {len(poses)} poses came during the drive")
    if vertical := _vertical_axis(path, poses):
        return PosesFound(vertical=vertical)
    fits = [_best(path, poses, mirrored) for mirrored in (False, True)]
    best, other = sorted((fit for fit in fits if fit is not None), key=lambda fit: fit.error)
    if not _explains(best, poses):
        raise CannotTell(_whose(path, others))
    if other.error < APART * best.error:
        raise CannotTell("the poses fit the wheels as badly mirrored as not: they are too noisy, or the wheels slipped")
    headings = _headings(path, poses, best.lateness)
    if headings is None:
        raise CannotTell("the headings of the poses do not follow the turns of the robot, in radians or in degrees")
    if (headings.slope < 0.0) is not best.mirrored:
        raise CannotTell(
            "the positions of the poses turn one way and their headings the other. Negate the heading where the poses "
            "come from"
        )
    late = lateness_of(path, _for_lateness(all_poses, best.mirrored, headings.unit), best.lateness)
    if late is not None:
        best = _fit(path, poses, best.mirrored, late.seconds) or best
    return _found(best, headings, late)


def _for_lateness(poses: Sequence[Pose], mirrored: bool, unit: float) -> list[Seen]:
    thinned = _thinned(poses, MOST_FOR_LATENESS)
    headings = _unwrapped([pose.theta / unit for pose in thinned])
    places = [pose.place.conjugate() if mirrored else pose.place for pose in thinned]
    return [Seen(pose.time, place, angle) for pose, place, angle in zip(thinned, places, headings, strict=True)]


def _found(fit: _Fit, headings: _Headings, late: Lateness | None) -> PosesFound:
    metre = min(UNITS, key=lambda unit: abs(math.log(abs(fit.a) / unit)))
    offset = math.remainder(headings.begin - cmath.phase(fit.a), 2.0 * math.pi)
    point = 0j if abs(fit.point) < SMALL_POINT else fit.point
    is_late = late is None or abs(late.seconds) > SMALL_LATENESS
    is_sure = late is not None and abs(late.seconds) > SURE * late.deviation
    return PosesFound(
        metre=metre,
        degrees=headings.unit == DEGREES,
        mirrored=fit.mirrored,
        heading_offset=0.0 if abs(offset) < SMALL_ANGLE else offset,
        ahead=point.real,
        left=point.imag,
        lateness=fit.lateness if is_late and is_sure else 0.0,
        unsure_lateness=fit.lateness if is_late and not is_sure else 0.0,
        length=abs(fit.a) / metre,
        turn=abs(headings.slope),
    )


def _thinned(poses: Sequence[Pose], most: int = MOST) -> list[Pose]:
    return list(poses[:: max(1, len(poses) // most)])


def _whose(path: Path, others: Mapping[int, Sequence[Pose]]) -> str:
    """Return why these poses do not belong to this robot, and to which one they do."""
    for robot, poses in others.items():
        thinned = _thinned(poses)
        if len(thinned) < FEWEST or _vertical_axis(path, thinned):
            continue
        if any((fit := _best(path, thinned, hand)) is not None and _explains(fit, thinned) for hand in (False, True)):
            return (
                f"the poses do not move as this robot does, but those of robot {robot} do: the bodies are swapped "
                "where the poses come from"
            )
    return (
        "the poses do not move as this robot does: they are of another body, or the robot was not seen. Check which "
        "body has the number of this robot"
    )


def _spreads(values: Sequence[complex]) -> tuple[float, float]:
    mean = sum(values) / len(values)
    return (
        math.sqrt(sum((value - mean).real ** 2 for value in values) / len(values)),
        math.sqrt(sum((value - mean).imag ** 2 for value in values) / len(values)),
    )


def _vertical_axis(path: Path, poses: Sequence[Pose]) -> str:
    """Return the axis, x or y, that does not change while the other does; "" if there is none."""
    along, across = _spreads(path.places)
    if across < WIDE * along:
        raise CannotTell("the robot did not drive as planned: too straight a way")
    x, y = _spreads([pose.place for pose in poses])
    is_flat = min(x, y) < FLAT * max(x, y)
    return "" if not is_flat else "x" if x < y else "y"


def _explains(fit: _Fit, poses: Sequence[Pose]) -> bool:
    """Return whether the wheels explain most of the poses' motion."""
    spread = math.hypot(*_spreads([pose.place for pose in poses])) / abs(fit.a) if fit.a else 0.0
    return spread > 0.0 and fit.error**2 < (1.0 - MOVES) * spread**2 and fit.error < 4 * PLACE


def _best(path: Path, poses: Sequence[Pose], mirrored: bool) -> _Fit | None:
    """Return the best fit of positions for one handedness, over latencies."""
    steps = round((LATEST - EARLIEST) / FINEST)
    fits = [_fit(path, poses, mirrored, EARLIEST + step * FINEST) for step in range(steps + 1)]
    known = [fit for fit in fits if fit is not None]
    if not known:
        return None
    place = min(range(len(known)), key=lambda number: known[number].error)
    best = known[place]
    if 0 < place < len(known) - 1:
        before, after = (known[place + step].error ** 2 for step in (-1, 1))
        bend = before - 2.0 * best.error**2 + after
        if bend > 0.0:
            finer = _fit(path, poses, mirrored, best.lateness + 0.5 * FINEST * (before - after) / bend)
            best = finer if finer is not None and finer.error < best.error else best
    return best


def _fit(path: Path, poses: Sequence[Pose], mirrored: bool, lateness: float) -> _Fit | None:
    rows, values = [], []
    for pose in poses:
        place, heading = path.at(pose.time - lateness)
        ahead = cmath.rect(1.0, heading)
        row = (place.conjugate(), ahead.conjugate(), 1.0) if mirrored else (place, ahead, 1.0)
        rows.append(row)
        values.append(pose.place)
    try:
        a, b, c = least_squares(rows, values)
    except Undetermined:
        return None
    if not a:
        return None
    left = sum(abs(row[0] * a + row[1] * b + c - value) ** 2 for row, value in zip(rows, values, strict=True))
    point = b / a
    return _Fit(mirrored, lateness, a, point.conjugate() if mirrored else point, math.sqrt(left / len(rows)) / abs(a))


def _headings(path: Path, poses: Sequence[Pose], lateness: float) -> _Headings | None:
    """Return the relation of headings to the wheels' rotation; None if there is none in either unit."""
    turned = [path.at(pose.time - lateness)[1] for pose in poses]
    for unit in (1.0, DEGREES):
        shown = _unwrapped([pose.theta / unit for pose in poses])
        slope, begin = (value.real for value in least_squares([(angle, 1.0) for angle in turned], shown))
        error = math.sqrt(sum((slope * a + begin - b) ** 2 for a, b in zip(turned, shown, strict=True)) / len(shown))
        if abs(abs(slope) - 1.0) < HEADING_SHARE and error < 4 * ANGLE:
            return _Headings(unit, slope, begin, error)
    return None


def _unwrapped(angles: Sequence[float]) -> list[float]:
    """Unwrap angles (rad)."""
    whole = [angles[0]]
    for angle in angles[1:]:
        whole.append(whole[-1] + math.remainder(angle - whole[-1], 2.0 * math.pi))
    return whole
