"""Rows of the camera: methods to find a tag's corners, a picture with five robots, and pictures without tags."""

import math
import os
from collections.abc import Callable, Iterator
from typing import Any

import cv2
import numpy as np

from benchmarks.report import Row
from benchmarks.timing import clocked, in_turns
from cmr.camera.tags import TagFinder
from cmr.camera.watcher import Watcher
from tests.support.camera_bench import EYE, floor_of, lens_of, robots
from tests.support.clutter import cluttered
from tests.support.rendered_floor import FLOOR_TAGS, Scene

LONGEST = 0.05  # s for a picture: 20 a second
PICTURES = 4
METHODS = ("SUBPIX", "CONTOUR", "APRILTAG")
WITHOUT_TAGS = int(
    os.environ.get("CMR_PICTURES_WITHOUT_TAGS", "300")
)  # the specification has 10,000, which take ten minutes


def camera() -> Iterator[Row]:
    """Measure the time for a picture of 1280 x 720 with five robots and four floor tags, on one core."""
    cv2.setNumThreads(1)
    floor = Scene(EYE, FLOOR_TAGS, blur=0.8)
    scenes = [robots(seed) for seed in range(PICTURES)]
    pictures = [floor.picture(scene) for scene in scenes]
    works: dict[str, Callable[[Any], Any]] = {name: _opencv(name) for name in METHODS}
    works["cmr.camera.edges"] = _ours
    timings = in_turns({name: clocked(_turns(work, pictures)) for name, work in works.items()}, repetitions=3)
    for name, work in works.items():
        off = [_off(work(picture), scene) for picture, scene in zip(pictures, scenes, strict=True)]
        yield Row(
            f"corners of 9 tags by {name}: {np.mean(off):.2f} pixels off (rms)", _milliseconds(timings[name].median)
        )
    watcher = Watcher(lens_of(EYE), floor_of())
    timing = in_turns({"": clocked(_turns(watcher.watch, pictures))})[""]
    yield Row(
        "cmr-camera: a picture of 1280 x 720, five robots, found and located",
        _milliseconds(timing.median),
        goal=_milliseconds(LONGEST),
        reached=timing.median <= LONGEST,
    )
    yield _without_tags(watcher)


def _without_tags(watcher: Watcher) -> Row:
    """Count the tags that are found in pictures without tags."""
    found = sum(bool(watcher.watch(cluttered(seed, EYE.width, EYE.height))) for seed in range(WITHOUT_TAGS))
    found += sum(watcher.rejected.values())
    return Row(
        f"cmr-camera: pictures without a tag, {WITHOUT_TAGS:,}: false tags", str(found), goal="0", reached=not found
    )


def _ours(picture: Any) -> dict[int, Any]:
    return {tag.number: tag.corners for tag in TagFinder(lens_of(EYE)).find(picture)}


def _opencv(name: str) -> Callable[[Any], dict[int, Any]]:
    """Return a tag finder with one of OpenCV's own refinements."""
    settings = cv2.aruco.DetectorParameters()
    settings.cornerRefinementMethod = getattr(cv2.aruco, f"CORNER_REFINE_{name}")
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11), settings)
    lens = lens_of(EYE)

    def find(picture: Any) -> dict[int, Any]:
        corners, numbers, _ = detector.detectMarkers(picture)
        straight = [lens.straight(np.asarray(places, float).reshape(4, 2)) for places in corners]
        return dict(zip(np.ravel(numbers).tolist(), straight, strict=True))

    return find


def _off(found: dict[int, Any], scene: list[Any]) -> float:
    """Return the rms error of corners against the renderer's [pixels]."""
    true = {sheet.number: sheet.corners for sheet in (*FLOOR_TAGS, *(robot.sheet for robot in scene))}
    gaps = [found[number] - lens_of(EYE).straight(EYE.pixels(true[number])) for number in found]
    return math.sqrt(float(np.mean(np.sum(np.square(gaps), axis=2))))


def _turns(work: Callable[[Any], Any], pictures: list[Any]) -> Callable[[], object]:
    """Return a function that works on the pictures in turn."""
    numbers = iter(range(10**9))
    return lambda: work(pictures[next(numbers) % len(pictures)])


def _milliseconds(seconds: float) -> str:
    return f"{1e3 * seconds:.0f} ms"
