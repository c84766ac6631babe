"""Estimate the pose of the camera from the tags on the floor."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import cv2
import numpy as np

from cmr.camera.floor import Floor
from cmr.camera.lens import Floats, Lens
from cmr.camera.tags import Tag

FEWEST_SEEN = 3  # tags on the floor needed to place the camera; a fourth reveals one that was moved
MEMORY = 200  # pictures over which the corners of the floor's tags are averaged, while nothing moves
SETTLING = 20  # pictures after a change during which the pose is estimated again each time
MOVED = 1.5  # pixels by which a corner must shift for the camera, or the tag, to count as moved
WORST = 3.0  # pixels (rms) residual of a tag's corners; above, its place in the file is wrong


class Unplaced(Exception):  # noqa: N818 - it is a finding, not a failure of the program
    """The camera cannot be placed; the text says why."""


@dataclass(frozen=True)
class Place:
    """Pose of the camera: `axes` (3, 3), rows its right, down and ahead in the world, and `eye` (3) [m; world].

    `rms` [pixels] is the residual of the floor's tags.
    """

    axes: Floats
    eye: Floats
    rms: float = 0.0

    def before_camera(self, points: Floats) -> Floats:
        """Return points of the world (n, 3) in the camera's axes [m]."""
        return (np.asarray(points, float) - self.eye) @ self.axes.T

    def on_plane(self, directions: Floats, z: float) -> Floats:
        """Return where rays in these directions (n, 3) of the camera's axes meet a height (n, 3) [m; world].

        NaN where they do not.
        """
        rays = directions @ self.axes
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = (z - self.eye[2]) / rays[:, 2]
        reach = np.where(reach > 0.0, reach, np.nan)
        return np.asarray(self.eye + reach[:, None] * rays)


class PlaceFinder:
    """Tracks the camera's pose from the floor's tags, averaged while the camera stands still."""

    def __init__(self, lens: Lens, floor: Floor) -> None:
        self.lens, self.floor = lens, floor
        self.place: Place | None = None
        self.problem = "No picture yet."
        self._corners: dict[int, Floats] = {}
        self._seen: dict[int, int] = {}
        self._pictures = 0  # since the last change

    def see(self, tags: Iterable[Tag]) -> None:
        """Process the tags of a picture. While the camera cannot be placed, `place` is None and `problem` says why."""
        on_floor = {tag.number: tag.corners for tag in tags if tag.number in self.floor.tags}
        moved = [number for number, corners in on_floor.items() if self._moved(number, corners)]
        if len(moved) > len(on_floor) // 2:  # most tags moved: the camera did
            self._corners.clear()
            self._seen.clear()
        for number in moved:
            self._seen.pop(number, None)
        news = not set(on_floor) <= set(self._seen)
        for number, corners in on_floor.items():
            count = min(self._seen.get(number, 0) + 1, MEMORY)
            before = self._corners[number] if count > 1 else corners
            self._seen[number], self._corners[number] = count, before + (corners - before) / count
        # One more picture hardly changes an average over many: then the pose is estimated only now and then.
        self._pictures = 0 if news else self._pictures + 1
        if self.place is None or self._pictures < SETTLING or self._pictures % SETTLING == 0:
            self._find()

    def _moved(self, number: int, corners: Floats) -> bool:
        before = self._corners.get(number)
        return before is not None and float(np.abs(corners - before).max()) > MOVED

    def _find(self) -> None:
        try:
            self.place = found(
                self.lens, {number: self.floor.tags[number].corners for number in self._corners}, self._corners
            )
            self.problem = ""
        except Unplaced as unplaced:
            self.place, self.problem = None, str(unplaced)


def found(lens: Lens, world: Mapping[int, Floats], seen: Mapping[int, Floats]) -> Place:
    """Return the camera's place from the corners of tags in the world (4, 3) and in straight pixels (4, 2), by number.

    Raises Unplaced, if too few tags are seen, or if one does not fit (named in the text).
    """
    if len(seen) < FEWEST_SEEN:
        raise Unplaced(f"{len(seen)} of the floor's {FEWEST_SEEN} needed tags are seen.")
    numbers = sorted(seen)
    place, off = _fitted(lens, [world[n] for n in numbers], [seen[n] for n in numbers])
    if off.max() > WORST:
        raise Unplaced(_suspect(lens, numbers, world, seen, off))
    return place


def _suspect(
    lens: Lens, numbers: list[int], world: Mapping[int, Floats], seen: Mapping[int, Floats], off: Floats
) -> str:
    """Return a sentence that names the tag whose place in the file is wrong: without it, all others fit."""
    for left_out in numbers:
        others = [n for n in numbers if n != left_out]
        if len(others) >= FEWEST_SEEN:
            _, rest = _fitted(lens, [world[n] for n in others], [seen[n] for n in others])
            if rest.max() <= WORST:
                return f"Tag {left_out} is not where the floor file says; the others fit without it."
    worst = numbers[int(off.argmax())]
    return (
        f"The tags are not where the floor file says, by {off.max():.0f} pixels at tag {worst}; or this is not the "
        "calibrated lens."
    )


def _fitted(lens: Lens, world: list[Floats], seen: list[Floats]) -> tuple[Place, Floats]:
    """Return the best-fitting camera pose, and for each tag the rms residual of its corners [pixels]."""
    points, pixels = np.concatenate(world), np.concatenate(seen)
    found, turn, shift = cv2.solvePnP(points, pixels, lens.matrix, None, flags=cv2.SOLVEPNP_IPPE)
    if not found:
        raise Unplaced("The floor's tags lie in one line.")
    turn, shift = cv2.solvePnPRefineLM(points, pixels, lens.matrix, None, turn, shift)
    axes = np.asarray(cv2.Rodrigues(turn)[0], float)
    eye = -axes.T @ np.asarray(shift, float).ravel()
    if eye[2] <= 0.0:
        raise Unplaced("Seen through the floor: the tags' places in the floor file are mirrored.")
    ahead = (points - eye) @ axes.T
    again = ahead[:, :2] / ahead[:, 2:] * (lens.fx, lens.fy) + (lens.cx, lens.cy)
    squares = ((again - pixels) ** 2).sum(axis=1).reshape(-1, 4)
    return Place(axes, eye, float(np.sqrt(squares.mean()))), np.sqrt(squares.mean(axis=1))
