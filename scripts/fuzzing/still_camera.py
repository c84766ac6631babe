"""A camera that always shows the same floor with a robot on it, timestamped with the stepped time."""

import importlib
from pathlib import Path
from typing import Any

from cmr.bus.messages import now_utime
from cmr.camera.sources import Taken
from tests.support.camera_bench import floor_file, lens_of
from tests.support.rendered_floor import FLOOR_TAGS, Box, Eye, Scene

EYE = Eye(width=640, height=360, focal=460.0, centre=(324.0, 177.0))
PERIOD = 0.2  # s of real time between pictures: the camera's thread must leave time to the fuzzed one


class StillCamera:
    """A source of pictures that has only one."""

    ends = False

    def __init__(self) -> None:
        self._picture = Scene(EYE, FLOOR_TAGS).picture([Box(0.3, 0.1, 1.0, 0)])
        self._rest: Any = importlib.import_module("time").sleep

    def read(self) -> Taken:
        """Return the picture with the current time."""
        self._rest(PERIOD)
        return Taken(now_utime(), self._picture)

    def close(self) -> None:
        """Do nothing: there is no device."""


def install_still_camera(folder: Path) -> None:
    """Replace all picture sources by the still camera, and write the files of its lens and its floor."""
    lens_of(EYE).save(folder / "lens.yaml")
    floor_file(folder)
    sources: Any = importlib.import_module("cmr.camera.sources")
    sources.open_source = lambda *_arguments, **_options: StillCamera()
