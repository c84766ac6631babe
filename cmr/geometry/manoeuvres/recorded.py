"""A recorded drive: its file, and its use as a manoeuvre, duties over time.

schema: 1
recorded: 2026-01-31T12:00:00Z
robot_id: 10
space: 1.24          # m; how far a typical robot may get from where it begins
knots:               # time [s], duty of the left side, duty of the right side; straight lines between them
- [0.02, 0.31, 0.31]
"""

from collections.abc import Sequence
from datetime import datetime, timezone
from pathlib import Path

import numpy as np

from cmr.documents.bounds import Bounds
from cmr.documents.document import DocumentError, Item, read_file
from cmr.files import write_atomically
from cmr.geometry.manoeuvres.manoeuvre import Manoeuvre
from cmr.geometry.manoeuvres.pieces import Floats, Piece, rest

SCHEMA = 1
SUFFIX = ".yaml"
KEYS = ("schema", "recorded", "robot_id", "space", "knots")
LONGEST = 3600.0  # s
LARGEST_SPACE = 1000.0  # m
SAME = 0.002  # duty; a knot this close to the line between its neighbours is dropped


class RecordedDriveError(DocumentError, ValueError):
    """The file of a recorded drive cannot be used; the text says what is wrong, in which line, and what is allowed."""

    bounds = Bounds(size=4_000_000, values=300_000, is_simple=True)


def load(path: Path) -> Manoeuvre:
    """Read a recorded drive. Raises RecordedDriveError when it is missing, unreadable or wrong."""
    section = read_file(path, RecordedDriveError).section(KEYS)
    section["schema"].whole(SCHEMA, SCHEMA)
    piece = _piece(section["knots"])
    return Manoeuvre(
        name=str(path),
        what="a drive that was recorded",
        good_for="driving it again",
        space=section["space"].number(0.01, LARGEST_SPACE),
        gives=frozenset(),
        pieces=lambda _turn_time: [piece, rest()],
    )


def _piece(knots: Item) -> Piece:
    """Return the knots, whose times are above 0 and increase."""
    rows = [(item, item.numbers("time left right")) for item in knots.items()]
    before = 0.0
    for item, (time, left, right) in rows:
        if not before < time <= LONGEST:
            raise item.place.error(f"the time must be above {before:g} s and {LONGEST:g} s at most, not {time:g} s")
        if max(abs(left), abs(right)) > 1.0:
            raise item.place.error("duties must be from -1 to 1")
        before = time
    if not rows:
        raise knots.place.error("must hold at least one knot")
    return np.array([values for _, values in rows])


def save(path: Path, knots: Floats, robot_id: int, space: float) -> None:
    """Write a drive: knots (n, 3) of time [s] and both duties, and the space [m] that a typical robot needs for it.

    Raises OSError where the file cannot be written.
    """
    now = datetime.now(timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ")
    lines = [f"schema: {SCHEMA}", f"recorded: {now}", f"robot_id: {robot_id}", f"space: {space:.2f}", "knots:"]
    lines += [f"- [{time:.3f}, {left:.4f}, {right:.4f}]" for time, left, right in thinned(knots)]
    write_atomically("\n".join(lines) + "\n", path)


def thinned(knots: Floats) -> Sequence[tuple[float, float, float]]:
    """Return knots (n, 3) without those that lie on the line between the last one kept and the next."""
    kept: list[int] = [0]
    for k in range(1, len(knots) - 1):
        last, here, following = knots[kept[-1]], knots[k], knots[k + 1]
        share = (here[0] - last[0]) / (following[0] - last[0])
        if np.abs(last[1:] + share * (following[1:] - last[1:]) - here[1:]).max() > SAME or k - kept[-1] > 500:
            kept.append(k)
    kept += [len(knots) - 1] if len(knots) > 1 else []
    return [(float(time), float(left), float(right)) for time, left, right in knots[kept]]
