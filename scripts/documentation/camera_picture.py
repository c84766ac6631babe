"""Draw virtual robots into a rendered picture of a floor with real robots, with the code of cmr-camera."""

import math
from pathlib import Path

import cv2
import numpy as np

from cmr.camera.drawing import Drawer, Waypoints
from cmr.camera.place import Place
from cmr.camera.tracks import Shown
from tests.support.camera_bench import CARRIED, lens_of
from tests.support.rendered_floor import FLOOR_TAGS, Box, Eye, Scene

EYE = Eye(position=(0.0, -2.4, 1.6), looks_at=(0.0, 0.2, 0.0))
REAL = (Box(-0.52, 0.22, 0.4, 0), Box(0.12, -0.12, -0.7, 1), Box(0.5, 0.42, 0.9, 2))
SIZE = (960, 540)  # pixels


def draw(path: Path) -> None:
    """Write the picture: three virtual robots with trails and waypoints, in front of and behind real ones."""
    arc = [
        (-0.45 + 0.57 * share, 0.55 - 0.41 * math.sin(0.5 * math.pi * share)) for share in (k / 20 for k in range(21))
    ]
    virtual = [
        Shown(10, 0.12, 0.14, 2.5, arc),
        Shown(11, -0.42, -0.04, -0.9, [(-0.1, 0.25), (-0.42, -0.04)]),
        Shown(12, -0.12, 0.72, 3.1, [(0.4, 0.6), (-0.12, 0.72)]),
    ]
    real = [(Shown(box.tag or 0, box.x, box.y, box.theta, []), CARRIED) for box in REAL]
    picture = np.asarray(cv2.cvtColor(Scene(EYE, FLOOR_TAGS).picture(REAL), cv2.COLOR_GRAY2BGR), np.uint8)
    way = Waypoints((0.12, 0.55, 0.75, 0.7), (0.14, 0.42, 0.2, -0.12))
    drawn = Drawer(lens_of(EYE), CARRIED).draw(picture, Place(EYE.axes, np.array(EYE.position)), virtual, real, [way])
    small = cv2.resize(drawn, SIZE, interpolation=cv2.INTER_AREA)
    cv2.imwrite(str(path), small, [cv2.IMWRITE_PNG_COMPRESSION, 9])
