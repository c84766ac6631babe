"""Draw the packages for ARCHITECTURE.md from the imports: upper packages import lower ones."""

from collections.abc import Iterator, Mapping, Sequence, Set
from html import escape
from itertools import pairwise
from typing import NamedTuple

from documentation.imports import PROJECT, between_packages, imports, modules

PICTURE = PROJECT / "docs" / "pictures" / "packages.svg"
# Any package may import these, and they import only each other. Arrows to them would clutter the picture.
GROUND = (
    *("cmr.cli", "cmr.documents", "cmr.report", "cmr.distribution", "cmr.files", "cmr.priority", "cmr.threads"),
    "cmr.workers",
)
OMITTED = ("cmr", "cmr.__main__", "cmr.experiments")  # they only contain other packages, or start one
WIDTH, HEIGHT = 164, 30  # px, of a box
APART, POINT = 16, 4  # px between boxes in a row; width of an arrow that passes through a row
DOWN = 74  # px between rows
MARGIN = 20  # px
# Colours of arrows, by the box they leave; all are visible on white and on black (Okabe and Ito's, some darker).
COLOURS = ("#0072b2", "#d55e00", "#00846a", "#b0578d", "#777777", "#a07800")
SWEEPS = 8  # over the rows, to place boxes near their neighbours
STYLE = """\
text { font: 13px system-ui, sans-serif; text-anchor: middle; fill: #1a1a1a }
rect { fill: #fff; stroke: #555 }
.device { fill: #fdf3d0 }
.ground { fill: #eee }
path { fill: none; stroke-width: 1.3 }
.back { fill: #fff; stroke: none }
@media (prefers-color-scheme: dark) {
  text { fill: #eee }
  rect { fill: #262626; stroke: #999 }
  .device { fill: #4a3f14 }
  .ground { fill: #3a3a3a }
  .back { fill: #121212 }
}"""

Graph = Mapping[str, Set[str]]


def packages() -> dict[str, set[str]]:
    """Return the packages in the picture, each with the packages that it imports."""
    sources = modules()
    graph = between_packages(imports(sources), sources)
    hidden = {*GROUND, *OMITTED}
    return {name: imported - hidden for name, imported in sorted(graph.items()) if name not in hidden}


def depths(graph: Graph) -> dict[str, int]:
    """Return the row of each package: 0 if it imports none, otherwise one above the highest that it imports."""
    found: dict[str, int] = {}
    while len(found) < len(graph):
        ready = [name for name, imported in graph.items() if name not in found and imported <= found.keys()]
        if not ready:
            raise ValueError(f"import cycle between packages: {sorted(graph.keys() - found.keys())}")
        found |= {name: max((found[other] + 1 for other in graph[name]), default=0) for name in ready}
    return found


def reduced(graph: Graph) -> dict[str, set[str]]:
    """Return the graph without transitive arrows: imports that are also imported indirectly."""
    below: dict[str, set[str]] = {}
    for name in sorted(graph, key=depths(graph).__getitem__):
        below[name] = set(graph[name]).union(*(below[other] for other in graph[name]))
    return {
        name: {lower for lower in imported if not any(lower in below[other] for other in imported)}
        for name, imported in graph.items()
    }


class Layout(NamedTuple):
    """Positions of the boxes, and of the points through which arrows pass [px].

    A position is the middle of a box's upper side. Arrows over several rows pass between the boxes of the rows between.
    """

    places: Mapping[str, tuple[float, float]]
    ways: dict[tuple[str, str], list[str]]  # for each arrow: the names of its points, including its ends
    width: float
    height: float


def layout(graph: Graph) -> Layout:
    """Return the positions of packages: by row, and within a row as near as possible to their neighbours."""
    depth = depths(graph)
    ways: dict[tuple[str, str], list[str]] = {}
    members = {row: [name for name in graph if depth[name] == row] for row in range(max(depth.values()) + 1)}
    for name in graph:
        for imported in sorted(graph[name]):
            between = [f"{name}>{imported}:{row}" for row in range(depth[name] - 1, depth[imported], -1)]
            ways[name, imported] = [name, *between, imported]
            for row, point in zip(range(depth[name] - 1, depth[imported], -1), between, strict=True):
                members[row].append(point)
    neighbours: dict[str, set[str]] = {name: set() for row in members.values() for name in row}
    for way in ways.values():
        for one, other in pairwise(way):
            neighbours[one].add(other)
            neighbours[other].add(one)
    for _ in range(SWEEPS):
        for row in (*members, *reversed(members)):
            x = _across(members)
            means = {
                name: sum(x[neighbour] for neighbour in neighbours[name]) / max(len(neighbours[name]), 1) for name in x
            }
            members[row].sort(key=lambda name: (round(means[name], 6), name))
    x = _across(members)
    left = min(x.values()) - WIDTH / 2 - MARGIN
    top = max(members)
    places = {name: (x[name] - left, MARGIN + (top - row) * DOWN) for row in members for name in members[row]}
    right = max(place[0] for place in places.values()) + WIDTH / 2 + MARGIN
    return Layout(places, ways, right, (top + 2) * DOWN - (DOWN - HEIGHT) + 2 * MARGIN)


def _across(members: Mapping[int, Sequence[str]]) -> dict[str, float]:
    """Return the middle of each box and of each point of an arrow, with every row centred at 0 [px]."""
    found: dict[str, float] = {}
    for row in members.values():
        widths = [POINT if ">" in name else WIDTH for name in row]
        at = -(sum(widths) + APART * (len(row) - 1)) / 2.0
        for name, width in zip(row, widths, strict=True):
            found[name] = at + width / 2.0
            at += width + APART
    return found


def picture() -> str:
    """Return the picture as SVG."""
    graph = reduced(packages())
    laid = layout(graph)
    width, height = f"{laid.width:g}", f"{laid.height:g}"
    boxes = {name: laid.places[name] for name in graph}
    colours = {name: number % len(COLOURS) for number, name in enumerate(sorted(graph, key=boxes.__getitem__))}
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}">',
        "<!-- Generated from the imports by scripts/write_architecture_picture; a test compares the two. -->",
        f"<style>\n{STYLE}\n</style>",
        *_heads(),
        f'<rect class="back" width="{width}" height="{height}"/>',
        *(_arrow([laid.places[point] for point in way], colours[source]) for (source, _), way in laid.ways.items()),
        *_boxes(boxes),
        *_ground(laid.width, laid.height),
        "</svg>",
    ]
    return "\n".join(lines) + "\n"


def _heads() -> Iterator[str]:
    """Yield an arrow head of each colour."""
    for number, colour in enumerate(COLOURS):
        yield (
            f'<marker id="head{number}" viewBox="0 0 8 8" refX="8" refY="4" markerWidth="8" markerHeight="8" '
            f'orient="auto"><path d="M0 1 L8 4 L0 7 z" style="fill: {colour}"/></marker>'
        )


def _arrow(points: Sequence[tuple[float, float]], colour: int) -> str:
    """Return an arrow from the lower side of the first box to the upper side of the last, vertical between others."""
    parts = [f"M{points[0][0]:g} {points[0][1] + HEIGHT:g}"]
    for (x1, y1), (x2, y2) in pairwise(points):
        start, end, half = y1 + HEIGHT, y2, (y2 - y1 - HEIGHT) / 2.0
        parts.append(f"C{x1:g} {start + half:g} {x2:g} {end - half:g} {x2:g} {end:g}")
        if (x2, y2) != points[-1]:
            parts.append(f"L{x2:g} {y2 + HEIGHT:g}")
    return f'<path d="{" ".join(parts)}" stroke="{COLOURS[colour]}" marker-end="url(#head{colour})"/>'


def _boxes(places: Mapping[str, tuple[float, float]]) -> Iterator[str]:
    for name, (x, y) in sorted(places.items()):
        kind = ' class="device"' if name.startswith("robot_driver") else ""
        yield f'<rect{kind} x="{x - WIDTH / 2:g}" y="{y:g}" width="{WIDTH}" height="{HEIGHT}" rx="4"/>'
        yield f'<text x="{x:g}" y="{y + 20:g}">{escape(label(name))}</text>'


def _ground(width: float, height: float) -> Iterator[str]:
    y = height - MARGIN - HEIGHT
    yield f'<rect class="ground" x="{MARGIN}" y="{y:g}" width="{width - 2 * MARGIN:g}" height="{HEIGHT}" rx="4"/>'
    names = ", ".join(map(label, GROUND))
    yield f'<text x="{width / 2:g}" y="{y + 20:g}">any package may import: {escape(names)}</text>'


def label(name: str) -> str:
    """Return the label of a box: the package's name without `cmr.`."""
    return name.removeprefix("cmr.").replace("experiments.", "experiments/").replace("driver.", "driver/")
