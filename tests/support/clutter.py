"""Pictures full of what resembles tags: frames, chequers, squares of random cells, writing, noise; no tag of 36h11."""

from typing import Any

import cv2
import numpy as np


def cluttered(seed: int, width: int, height: int) -> Any:
    """Return a grey picture without any tag of the family."""
    random = np.random.default_rng(seed)
    coarse = random.normal(128.0, 25.0, (height // 40, width // 40)).astype(np.float32)
    picture = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
    for _ in range(random.integers(5, 25)):
        _add(picture, random, random.choice(["chequers", "frame", "cells", "writing", "plain"]))
    picture = cv2.GaussianBlur(picture, (0, 0), random.uniform(0.4, 1.5))
    noise = random.normal(0.0, random.uniform(1.0, 8.0), picture.shape)
    return np.clip(picture + noise, 0.0, 255.0).astype(np.uint8)


def _add(picture: Any, random: np.random.Generator, kind: str) -> None:
    """Paint one thing somewhere, as seen at a slant."""
    height, width = picture.shape
    patch = _patch(random, kind)
    size = random.uniform(25.0, 250.0)
    corners = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]) + random.uniform(-0.12, 0.12, (4, 2))
    angle = random.uniform(0.0, 2.0 * np.pi)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    goal = (corners - 0.5) @ turn.T * size + random.uniform((0.0, 0.0), (width, height))
    high, wide = patch.shape
    start = np.array([(0, 0), (wide, 0), (wide, high), (0, high)], np.float32)
    warp = cv2.getPerspectiveTransform(start, goal.astype(np.float32))
    painted = cv2.warpPerspective(patch, warp, (width, height), flags=cv2.INTER_NEAREST, borderValue=-1.0)
    np.copyto(picture, painted, where=painted >= 0.0)


def _patch(random: np.random.Generator, kind: str) -> Any:
    dark, bright = random.uniform(5.0, 70.0), random.uniform(150.0, 250.0)
    if kind == "chequers":
        count = int(random.integers(2, 10))
        cells = np.indices((count, count)).sum(axis=0) % 2
    elif kind == "cells":  # a black frame with random cells, as a tag has, but of 5 x 5 or 7 x 7 cells
        inner = random.choice([5, 7])
        cells = np.pad(np.pad(random.integers(0, 2, (inner, inner)), 1), 1, constant_values=1)
    elif kind == "frame":
        cells = np.pad(np.pad(np.full((6, 6), random.integers(0, 2)), 1), 1, constant_values=1)
    else:
        cells = np.full((10, 10), random.integers(0, 2))
    patch = np.kron(np.where(cells > 0, bright, dark), np.ones((20, 20))).astype(np.float32)
    if kind == "writing":
        text = "".join(random.choice(list("AHKOQRMWB0859"), 6))
        ink = np.zeros(patch.shape, np.uint8)
        cv2.putText(ink, text, (5, 120), cv2.FONT_HERSHEY_SIMPLEX, 1.5, 255, 6)
        patch[ink > 127] = (dark + bright) / 2.0
    return patch
