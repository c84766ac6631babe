"""Detect tags of the AprilTag family 36h11 in a picture."""

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from cmr.camera.edges import refined
from cmr.camera.lens import Floats, Lens

FAMILY = cv2.aruco.DICT_APRILTAG_36h11
MOST_WRONG_BITS = 1  # of 36. Each further one detects a few more tags in bad light, and 30 times as many false ones.
MOST_WRONG_BORDER = 0.1  # share of the black border's cells that may be white
MIN_SIDE = 12.0  # pixels; in smaller tags a cell has at most 1.5 pixels


class Tag(NamedTuple):
    """A tag in a picture: its number and its corners (4, 2) [undistorted pixels], from top left as one sees the tag."""

    number: int
    corners: Floats

    @property
    def side(self) -> float:
        """The shortest side [pixels]."""
        return float(np.linalg.norm(np.roll(self.corners, -1, axis=0) - self.corners, axis=1).min())


class TagFinder:
    """Finds tags in the pictures of one lens."""

    def __init__(self, lens: Lens) -> None:
        self.lens = lens
        dictionary = cv2.aruco.getPredefinedDictionary(FAMILY)
        settings = cv2.aruco.DetectorParameters()
        settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_NONE  # `refined` is faster and more exact
        dictionary.maxCorrectionBits, settings.errorCorrectionRate = MOST_WRONG_BITS, 1.0
        settings.maxErroneousBitsInBorderRate = MOST_WRONG_BORDER
        settings.minMarkerPerimeterRate = 4.0 * MIN_SIDE / max(lens.width, lens.height)
        self._detector = cv2.aruco.ArucoDetector(dictionary, settings)

    def find(self, grey: NDArray[np.uint8]) -> list[Tag]:
        """Return the tags of a grey picture of the lens's size, each number once at most.

        A number seen twice is ambiguous: neither tag is returned.
        """
        corners, numbers, _ = self._detector.detectMarkers(grey)
        if numbers is None or not len(numbers):
            return []
        found = refined(grey.astype(np.float32), np.concatenate(corners).astype(float), self.lens)
        names = [int(number) for number in np.ravel(numbers)]
        return [Tag(name, place) for name, place in zip(names, found, strict=True) if names.count(name) == 1]
