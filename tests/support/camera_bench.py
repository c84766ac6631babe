"""What tests of the camera share: rendered scenes, the lens found from rendered pictures of the printed board."""

import math
import re
import zlib
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from cmr.camera.board import save_board
from cmr.camera.floor import Floor, FloorTag, RobotTag
from cmr.camera.lens import Lens
from cmr.camera.lens_fit import LensFit
from tests.support.rendered_floor import FLOOR_TAGS, Box, Eye, Pattern, Scene, Sheet

POINT = 0.0254 / 72.0  # m; a PDF's unit of length
EYE = Eye()
CARRIED = RobotTag(size=0.16, height=0.10, length=0.24, width=0.22)  # as rendered boxes are
FLOOR_FILE = """
schema: 1
tag_size: 0.16
tags:
{tags}
robots:
  each: {{height: 0.1, length: 0.24, width: 0.22}}
"""


def floor_file(folder: Path, tags: "tuple[Sheet, ...]" = FLOOR_TAGS, more: str = "") -> Path:
    """Write a floor file of rendered tags; `more` is said of the robots."""
    lines = [f"  {tag.number}: {{x: {tag.x}, y: {tag.y}, theta: {tag.theta}}}" for tag in tags]
    (folder / "floor.yaml").write_text(FLOOR_FILE.format(tags="\n".join(lines)) + more)
    return folder / "floor.yaml"


def floor_of(tags: "tuple[Sheet, ...]" = FLOOR_TAGS, **others: Any) -> Floor:
    """What a floor file would say of rendered tags."""
    return Floor({tag.number: FloorTag(tag.x, tag.y, tag.theta, tag.size) for tag in tags}, CARRIED, **others)


def lens_of(eye: Eye) -> Lens:
    """The lens as it is."""
    return Lens(eye.width, eye.height, eye.focal, eye.focal, *eye.centre, (*eye.lens, 0.0))


@cache
def scene(**settings: Any) -> Scene:
    """The usual floor under the usual camera."""
    return Scene(EYE, FLOOR_TAGS, **settings)


def contents(pdf: Path) -> bytes:
    """What is drawn on the page of a PDF on which most is."""
    found = re.findall(rb"stream\n(.*?)\nendstream", pdf.read_bytes(), re.DOTALL)
    return max(map(zlib.decompress, found), key=len)


def squares_of(pdf: Path) -> tuple[tuple[float, float], Any]:
    """The paper's size [m], and the page's black squares (n, 2, 2): lower left and upper right corner [m]."""
    data = pdf.read_bytes()
    box = re.search(rb"/MediaBox \[ ?([\d. ]+)\]", data)
    assert box is not None
    _, _, wide, high = (float(number) * POINT for number in box[1].split())
    paths = re.findall(rb"((?:[\d.]+ [\d.]+ [ml]\n){4})h\n\nf", contents(pdf))
    corners = np.array([[line.split()[:2] for line in path.splitlines()] for path in paths[1:]], float)  # 0: the paper
    return (wide, high), np.stack([corners.min(axis=1), corners.max(axis=1)], axis=1) * POINT


@cache
def printed_board() -> tuple[Any, float]:
    """The cells of the board, 0 black, and their size [m], as the printed page has them."""
    with TemporaryDirectory() as folder:
        save_board(Path(folder) / "board.pdf")
        _, squares = squares_of(Path(folder) / "board.pdf")
    cell = float((squares[:, 1] - squares[:, 0]).mean())
    places = np.round((squares[:, 0] - squares[:, 0].min(axis=0)) / cell).astype(int)
    columns, rows = places.max(axis=0) + 1
    cells = np.full((rows, columns), 255, np.uint8)
    cells[rows - 1 - places[:, 1], places[:, 0]] = 0
    return cells, cell


def board_pictures(count: int, eye: Eye = EYE, seed: int = 0) -> list[Any]:
    """Pictures of the board, held before the camera here and there, and tilted."""
    cells, cell = printed_board()
    random = np.random.default_rng(seed)
    room = Scene(eye, blur=0.7, noise=3.0)
    pictures = []
    for k in range(count):
        ahead, across, down = eye.axes[2], eye.axes[0], eye.axes[1]
        distance = random.uniform(0.42, 0.6)
        reach = distance / eye.focal
        u, v = ((k % 3) - 1) * 0.27 * eye.width, ((k // 3 % 3) - 1) * 0.25 * eye.height
        centre = eye.position + distance * ahead + reach * (u * across + v * down)
        tilt, turn = random.uniform(0.3, 0.7), 2.0 * math.pi * k / count
        axis = math.cos(turn) * across + math.sin(turn) * down
        right, up = (_turned(vector, axis, tilt) for vector in (across, -down))
        pictures.append(room.picture([Pattern(cells, cell, tuple(centre), tuple(right), tuple(up))]))
    return pictures


@cache
def found_lens() -> Lens:
    """The usual camera's lens as `cmr-camera calibrate` finds it."""
    fit = LensFit()
    for picture in board_pictures(8):
        assert fit.see(picture)
    return fit.lens()


def robots(seed: int, count: int = 5) -> list[Box]:
    """Robots beside each other, turned any way, numbers 0 to count - 1."""
    random = np.random.default_rng(seed)
    return [
        Box(0.42 * (k - (count - 1) / 2.0), random.uniform(-0.45, 0.45), random.uniform(-math.pi, math.pi), k)
        for k in range(count)
    ]


def _turned(vector: Any, axis: Any, angle: float) -> Any:
    """Rodrigues' formula."""
    c, s = math.cos(angle), math.sin(angle)
    return c * vector + s * np.cross(axis, vector) + (1.0 - c) * (axis @ vector) * axis
