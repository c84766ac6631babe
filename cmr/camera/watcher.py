"""One camera over the floor: pictures in, poses of robots out."""

from collections import Counter

import cv2
import numpy as np
from numpy.typing import NDArray

from cmr.camera.floor import Floor
from cmr.camera.lens import Lens
from cmr.camera.place import Place, PlaceFinder
from cmr.camera.robots import Pose, robot_pose
from cmr.camera.tags import TagFinder


class Watcher:
    """Finds robots in the pictures of one camera; it uses neither cameras nor the bus.

    `rejected` counts the robots' tags that gave no pose, by reason; `problem` says why there are no poses at all.
    """

    def __init__(self, lens: Lens, floor: Floor) -> None:
        self.lens, self.floor = lens, floor
        self.rejected: Counter[str] = Counter()
        self.problem = ""
        self._tags = TagFinder(lens)
        self._place = PlaceFinder(lens, floor)

    @property
    def place(self) -> Place | None:
        """Pose of the camera, None while it is unknown."""
        return self._place.place

    def watch(self, picture: NDArray[np.uint8]) -> dict[int, Pose]:
        """Return the poses of robots in a picture, grey or blue-green-red, by robot id."""
        height, width = picture.shape[:2]
        if (width, height) != (self.lens.width, self.lens.height):
            self.problem = (
                f"The pictures are {width} x {height}, the lens was calibrated with {self.lens.width} x "
                f"{self.lens.height}: set the camera to that size, or calibrate again."
            )
            return {}
        grey = picture if picture.ndim == 2 else np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), np.uint8)
        tags = self._tags.find(grey)
        self._place.see(tags)
        self.problem = self._place.problem
        poses: dict[int, Pose] = {}
        for tag in tags if self.place else ():
            robot_id = self.floor.robot_id(tag.number)
            if robot_id is None or self.place is None:
                continue
            pose = robot_pose(tag, self.floor.robot_tag(tag.number), self.lens, self.place)
            if isinstance(pose, str):
                self.rejected[pose] += 1
            else:
                poses[robot_id] = pose
        return poses
