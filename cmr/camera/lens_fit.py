"""Estimate the lens from pictures of the printed board."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from cmr.camera.board import board
from cmr.camera.lens import Floats, Lens

FEWEST_PICTURES = 8
FEWEST_CORNERS = 8  # of 24, in a picture that counts
WORST_PICTURE = 2.5  # times the median: a picture that fits worse was blurred, and is left out
WORST_RMS = 1.0  # pixels; a board that fits worse is bent, or not ours
FEWEST_FIELDS = 7  # of 3 x 3 fields of the picture in which the board's corners were seen
# Largest standard deviation of the focal length, as a share of it: above, the board was never tilted.
MOST_UNSURE = 0.01


class LensError(Exception):
    """No lens can be estimated from these pictures; the text says what to do."""


@dataclass(frozen=True)
class View:
    """The board in a picture: its corners [m; board] (n, 3) and their pixels (n, 2)."""

    points: Floats
    pixels: Floats


class LensFit:
    """Collects pictures of the board, and estimates the lens from them."""

    def __init__(self) -> None:
        self.size: tuple[int, int] | None = None
        self.views: list[View] = []
        self._board = board()
        self._finder = cv2.aruco.CharucoDetector(self._board)

    def see(self, grey: NDArray[np.uint8]) -> bool:
        """Add a picture; return whether the board was found in it.

        Raises LensError when it is of another size than those before.
        """
        size = (grey.shape[1], grey.shape[0])
        if self.size not in (None, size):
            raise LensError(f"The pictures differ in size: {self.size} and {size}.")
        self.size = size
        corners, numbers, _, _ = self._finder.detectBoard(grey)
        if numbers is None or len(numbers) < FEWEST_CORNERS:
            return False
        points = np.asarray(self._board.getChessboardCorners())[np.ravel(numbers)]
        self.views.append(View(points.astype(float), np.asarray(corners, float).reshape(-1, 2)))
        return True

    def lens(self) -> Lens:
        """Return the lens. Raises LensError."""
        if self.size is None or len(self.views) < FEWEST_PICTURES:
            raise LensError(
                f"The board is seen in {len(self.views)} pictures; {FEWEST_PICTURES} are needed, 20 better."
            )
        _covered(self.views, self.size)
        lens, offs, _ = _fitted(self.views, self.size)
        good = offs <= WORST_PICTURE * np.median(offs)
        lens, _, unsure = _fitted([view for view, fits in zip(self.views, good, strict=True) if fits], self.size)
        if not lens.rms <= WORST_RMS:
            raise LensError(f"The board's corners are {lens.rms:.1f} pixels off: is it flat, and was it printed by us?")
        if not unsure <= MOST_UNSURE * lens.fx:
            raise LensError("The focal length is uncertain: hold the board tilted, by 30 to 45 degrees, to all sides.")
        return lens


def _covered(views: Iterable[View], size: tuple[int, int]) -> None:
    """Raise LensError unless corners were seen nearly all over the picture."""
    fields = np.concatenate([view.pixels for view in views]) / size * 3.0
    seen = {(int(u), int(v)) for u, v in np.clip(fields, 0.0, 2.999)}
    if len(seen) < FEWEST_FIELDS:
        raise LensError(
            f"The board was seen in {len(seen)} of the picture's 9 fields: bring it into all corners of the picture."
        )


def _fitted(views: list[View], size: tuple[int, int]) -> tuple[Lens, Floats, float]:
    """Return the lens, the rms residual of each picture [pixels], and the focal length's standard deviation."""
    # k3 stays 0: a third radial term does not improve the centre and distorts corners where no board was seen.
    rms, matrix, bent, _, _, unsure, _, offs = cv2.calibrateCameraExtended(
        [view.points.astype(np.float32) for view in views],
        [view.pixels.astype(np.float32) for view in views],
        size,
        np.eye(3),
        np.zeros(5),
        flags=cv2.CALIB_FIX_K3,
    )
    distortion = tuple(float(value) for value in np.ravel(bent)[:5])
    fx, fy, cx, cy = (float(matrix[row][column]) for row, column in ((0, 0), (1, 1), (0, 2), (1, 2)))
    if not all(map(math.isfinite, (fx, fy, cx, cy, *distortion))):
        raise LensError("No lens fits these pictures.")
    return Lens(*size, fx, fy, cx, cy, distortion, float(rms)), np.ravel(offs).astype(float), float(np.ravel(unsure)[0])
