"""Lens model: focal lengths, centre and distortion, as `cmr-camera calibrate` estimates them."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import cv2
import numpy as np
import yaml
from numpy.typing import NDArray

from cmr.documents.document import DocumentError, Item, quoted, read_file
from cmr.files import write_atomically

Floats = NDArray[np.float64]
Content: TypeAlias = dict[str, Any]  # a mapping of a camera file as YAML has it; values are checked where they are read
SCHEMA = 1
DISTORTION = ("k1", "k2", "p1", "p2", "k3")  # OpenCV's order
# Until the next step is below a thousandth of a pixel; a wide lens takes more steps than OpenCV's five.
PRECISELY = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 1e-3)


class CameraFileError(DocumentError):
    """A lens or floor file that cannot be used; the text names file and line, and what is wrong."""

    not_yaml = "cannot be read"
    empty = f"'schema: {SCHEMA}' is missing."


@dataclass(frozen=True)
class Lens:
    """Lens model with the size of its pictures; focal lengths and centre [pixels], distortion k1, k2, p1, p2, k3.

    Pixel (0, 0) has its centre at u = 0, v = 0. `straight` pixels are those of the same camera without distortion.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = (0.0,) * 5
    rms: float = math.nan  # pixels between the board's corners and the model's, when it was calibrated

    @property
    def matrix(self) -> Floats:
        """OpenCV's camera matrix."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    def straight(self, pixels: Floats) -> Floats:
        """Return undistorted pixels (n, 2) for pixels of the picture (n, 2)."""
        if not any(self.distortion):
            return np.asarray(pixels, float)
        points = np.asarray(pixels, float).reshape(-1, 1, 2)
        return np.asarray(
            cv2.undistortImagePoints(points, self.matrix, np.array(self.distortion), None, PRECISELY), float
        ).reshape(-1, 2)

    def pixels(self, points: Floats) -> Floats:
        """Return the pixels (n, 2) at which points in front of the camera (n, 3) [m; x right, y down, z ahead]
        appear.
        """
        seen, _ = cv2.projectPoints(
            np.asarray(points, float).reshape(-1, 1, 3),
            np.zeros(3),
            np.zeros(3),
            self.matrix,
            np.array(self.distortion),
        )
        return np.asarray(seen, float).reshape(-1, 2)

    def directions(self, straight: Floats) -> Floats:
        """Return the directions (n, 3) of undistorted pixels (n, 2), with z = 1; axes as in `pixels`."""
        x = (straight[:, 0] - self.cx) / self.fx
        y = (straight[:, 1] - self.cy) / self.fy
        return np.stack([x, y, np.ones_like(x)], axis=1)

    def save(self, path: Path) -> None:
        """Write the lens to a file. Raises OSError."""
        content = {
            "schema": SCHEMA,
            "width": self.width,
            "height": self.height,
            "fx": self.fx,
            "fy": self.fy,
            "cx": self.cx,
            "cy": self.cy,
            "distortion": dict(zip(DISTORTION, self.distortion, strict=True)),
            "rms": self.rms,
        }
        write_atomically(yaml.safe_dump(content, sort_keys=False), path)

    @classmethod
    def load(cls, path: Path) -> "Lens":
        """Read a lens file. Raises CameraFileError."""
        root, content = read_camera_file(path)
        try:
            bent = content["distortion"]
            numbers = {name: float(content[name]) for name in ("fx", "fy", "cx", "cy", "rms")}
            lens = cls(
                int(content["width"]),
                int(content["height"]),
                distortion=tuple(float(bent[name]) for name in DISTORTION),
                **numbers,
            )
        except (KeyError, TypeError, ValueError) as error:
            raise CameraFileError(f"{path} is no lens file of cmr-camera calibrate: {quoted(error)}") from error
        if lens.width <= 0 or lens.height <= 0 or not (lens.fx > 0.0 and lens.fy > 0.0):
            raise root.place.error("sizes and focal lengths are more than 0.")
        return lens


def read_camera_file(path: Path) -> tuple[Item, Content]:
    """Return the document of a YAML file of schema 1, and its mapping. Raises CameraFileError."""
    root = read_file(path, CameraFileError)
    content = root.value
    if not isinstance(content, dict) or content.get("schema") != SCHEMA:
        raise root.found(["schema"])._replace(key="").error(CameraFileError.empty)
    root.check_keys()
    return root, content
