"""The HTML page of a run, from its report.json."""

import numpy as np

from cmr.experiments.live.run_document import ProcessDocument, RobotDocument, RunDocument
from cmr.experiments.team.metrics import UNITS
from cmr.geometry.places import Disc
from cmr.report import density as swarm
from cmr.report.density import MOST_LINES
from cmr.report.keys import keys, real_key, simulated_key
from cmr.report.markup import Html, joined, tag
from cmr.report.numbers import number
from cmr.report.page import page_of
from cmr.report.section import Section, code, paragraph, quiet, section
from cmr.report.style import AFTER, INK, PAPER, REAL, REAL_OUTLINE
from cmr.report.svg import Curve, Floats, Frame, dots, line, plot
from cmr.report.table import table

WIDTH, TEXT = 600.0, 14.0  # so that text is legible on phones and screens
LABELS_X, LABELS_Y = 76.0, 66.0  # space for a frame's labels in its width and height
ROOM = 0.3  # m, free margin
LEAST, MOST = 0.35, 1.1  # height of the map over its width
MOST_ROWS = 40  # robots in the table
MOST_POINTS = 900  # of a drawn line
REAL_ROBOTS, VIRTUAL_ROBOTS = "real or emulated robot", "virtual robot"
CORNERS = np.linspace(0.0, 2.0 * np.pi, 25)  # of a disc as it is drawn

UNRELIABLE = tag("span", "unreliable", class_="unreliable")

METRICS = {name: name.replace("_", " ") for name in UNITS} | {"distance_driven": "driven on average"}


def run_page(document: RunDocument) -> str:
    """Return the page as self-contained HTML."""
    content = (_paths(document), _robots(document), _processes(document), _events(document))
    title = f"Run of {document['scenario']}"
    return page_of(title, _header(document), _key_numbers(document), content)


def _header(document: RunDocument) -> Html:
    """Return how the run ended."""
    words = f"{document['scenario']}: {document['seconds']:.0f} s, then {document['ended_by']}"
    badge = tag("span", "failed" if document["failed"] else "done", class_="badge")
    said = f" Began {document['began']}, seed {document['seed']}. {document['about']}"
    return tag("header", tag("h1", words), tag("p", badge, said), class_="bad" if document["failed"] else "plain")


def _key_numbers(document: RunDocument) -> Html:
    """Return the key numbers, and whether they are reliable."""
    doubtful = document["unreliable"]
    key = [
        _key("robots", f"{len(document['robots'])}"),
        *(
            _key(METRICS[name], f"{more_than(name, document)}{number(value, 3)} {UNITS[name]}", unreliable=doubtful)
            for name, value in document["metrics"].items()
        ),
        _key("world", f"{number(document['world_rate_hz'], 3)} Hz"),
        _key("late cycles", f"{document['overruns']}"),
        _key("restarts", f"{document['restarts']}"),
    ]
    note = tag("p", doubtful, class_="unreliable") if doubtful else Html("")
    return joined(tag("dl", *key, class_="key"), note)


def _key(name: str, value: str, unreliable: str = "") -> Html:
    """Return one key number, marked if it is unreliable."""
    return tag("div", tag("dt", name), tag("dd", value, *([" ", UNRELIABLE] if unreliable else [])))


def more_than(metric: str, document: RunDocument) -> str:
    """Return "over " for the time to goals that were not reached, which is that of the run."""
    return "over " if metric == "time_to_goal" and not document["waypoints_reached"] else ""


def _paths(document: RunDocument) -> Section:
    """Return the map: all paths, obstacles and the geofence."""
    robots = [robot for robot in document["robots"] if robot["path"]["x"]]
    if not robots:
        return section("Paths", paragraph("No robot was seen."))
    frame = _frame(document, robots)
    robots.sort(key=lambda robot: robot["kind"] == "virtual")
    lines, others = _lines_and_others(robots)
    drawn = [swarm.density(frame, [_places(robot) for robot in others])] if others else []
    drawn += _room(frame, document)
    drawn += [part for robot in reversed(lines) for part in _path(frame, robot)]
    picture = plot(
        frame,
        *drawn,
        x_label="x [m]",
        y_label="y [m]",
        along="time [s]",
        alt=f"Paths of {len(robots)} robots from above.",
    )
    entries = {robot["kind"] == "virtual" for robot in lines}
    key = keys(
        *([real_key(REAL_ROBOTS)] if False in entries else []),
        *([simulated_key(VIRTUAL_ROBOTS)] if True in entries else []),
        *(swarm.density_keys() if others else []),
    )
    words = "Paths of all robots from above. On a line, a ring is the start and a dot the end; a cross is a waypoint, "
    words += "the dashed line is the geofence."
    if others:
        words += f" {len(others)} robots are drawn as a density: the colour says how many of them passed a place."
    return section("Paths", tag("figure", key, tag("div", picture, class_="map"), tag("figcaption", words)))


def _lines_and_others(robots: list[RobotDocument]) -> tuple[list[RobotDocument], list[RobotDocument]]:
    """Return the robots that are drawn as lines, all or of a swarm the real and emulated ones, and the others."""
    if len(robots) <= MOST_LINES:
        return robots, []
    lines = [robot for robot in robots if robot["kind"] != "virtual"][:MOST_LINES]
    return lines, robots[len(lines) :]


def _frame(document: RunDocument, robots: list[RobotDocument]) -> Frame:
    """Return a frame that contains everything, with equal scales in x and y."""
    xs, ys = [[value for robot in robots for value in robot["path"][axis]] for axis in ("x", "y")]
    corners = [*(document["geofence"] or ()), *(w for r in robots[:MOST_ROWS] for w in r["waypoints"])]
    corners += [(d[0] + s * d[2], d[1] + s * d[2]) for d in document["obstacles"]["discs"] for s in (-1, 1)]
    corners += [end for wall in document["obstacles"]["walls"] for end in (wall[:2], wall[2:])]
    xs, ys = xs + [corner[0] for corner in corners], ys + [corner[1] for corner in corners]
    x, y = (min(xs) - ROOM, max(xs) + ROOM), (min(ys) - ROOM, max(ys) + ROOM)
    inner = WIDTH - LABELS_X
    shape = min(max((y[1] - y[0]) / (x[1] - x[0]), LEAST), MOST)
    metres = max((x[1] - x[0]) / inner, (y[1] - y[0]) / (shape * inner))
    about = (sum(x) / 2.0, sum(y) / 2.0)
    half = (metres * inner / 2.0, metres * shape * inner / 2.0)
    ranges = [(middle - size, middle + size) for middle, size in zip(about, half, strict=True)]
    return Frame(x=ranges[0], y=ranges[1], width=WIDTH, height=shape * inner + LABELS_Y, text=TEXT)


def _room(frame: Frame, document: RunDocument) -> list[Html]:
    """Return obstacles and the geofence."""
    drawn = []
    for disc in (Disc(*disc) for disc in document["obstacles"]["discs"]):
        x, y = disc.x + disc.radius * np.cos(CORNERS), disc.y + disc.radius * np.sin(CORNERS)
        drawn.append(line(frame, x, y, INK, 2.0, under=PAPER))
    for x1, y1, x2, y2 in document["obstacles"]["walls"]:
        drawn.append(line(frame, np.array([x1, x2]), np.array([y1, y2]), INK, 4.0, under=PAPER))
    if document["geofence"]:
        fence = np.array([*document["geofence"], document["geofence"][0]])
        drawn.append(line(frame, fence[:, 0], fence[:, 1], INK, 1.2, dashes="7 5", under=PAPER))
    return drawn


def _path(frame: Frame, robot: RobotDocument) -> list[Html]:
    """Return the path of one robot with its ends, and its waypoints."""
    x, y = _places(robot)
    virtual = robot["kind"] == "virtual"
    colour, outline = (AFTER, None) if virtual else (REAL, REAL_OUTLINE)
    shown = np.linspace(0, len(x) - 1, min(len(x), MOST_POINTS)).round().astype(int)
    curve = Curve(f"robot {robot['id']}", np.array(robot["path"]["t"])[shown])
    drawn = [line(frame, x[shown], y[shown], colour, 1.4 if virtual else 3.0, under=outline, curve=curve)]
    drawn += [_cross(frame, *place) for place in robot["waypoints"]]
    drawn += [dots(frame, x[:1], y[:1], INK, 10.0), dots(frame, x[:1], y[:1], PAPER, 7.0)]
    drawn.append(dots(frame, x[-1:], y[-1:], outline or colour, 8.0))
    return drawn


def _places(robot: RobotDocument) -> tuple[Floats, Floats]:
    """Return a robot's x and y [m], shape (n,)."""
    return np.array(robot["path"]["x"]), np.array(robot["path"]["y"])


def _cross(frame: Frame, x: float, y: float) -> Html:
    across, down = float(frame.across(np.array(x))), float(frame.down(np.array(y)))
    steps = f"M{across - 4:.1f} {down - 4:.1f}l8 8M{across - 4:.1f} {down + 4:.1f}l8 -8"
    return tag("path", d=steps, stroke=INK, stroke_width=1.2)


def _robots(document: RunDocument) -> Section:
    robots = document["robots"]
    headings = ["robot", "kind", "behaviour", "driven [m]"]
    if any(robot["waypoints"] for robot in robots):
        headings += ["waypoints", "last one reached after [s]"]
    rows = [_row(robot)[: len(headings)] for robot in robots[:MOST_ROWS]]
    more = f"The first {MOST_ROWS} of {len(robots)}; all are in report.json." if len(robots) > MOST_ROWS else ""
    near = document["nearest_robots"]
    nearest = (
        paragraph(
            f"Robots {near[0]} and {near[1]} came nearest to one another: "
            f"{number(document['minimum_separation_m'], 3)} m from centre to centre, "
            f"{number(document['nearest_at_s'], 3)} s after all were ready.",
            *([" ", UNRELIABLE] if document["unreliable"] else []),
        )
        if near
        else Html("")
    )
    return section("Robots", nearest, table(headings, rows, numbers=(3, 5)), quiet(more) if more else Html(""))


def _row(robot: RobotDocument) -> list[str]:
    """Return the table row of one robot."""
    count, reached = len(robot["waypoints"]), robot["goal_reached_at_s"]
    return [
        *(str(robot["id"]), robot["kind"], robot["behaviour"].replace(",", ", "), number(robot["distance_m"], 3)),
        f"{count - robot['waypoints_left']} of {count}" if count else "",
        number(reached, 3) if reached is not None else "",
    ]


def _processes(document: RunDocument) -> Section:
    rows = [
        [
            process["name"],
            str(process["starts"]),
            "; ".join(process["ends"]),
            number(process["loop_rate_hz"], 3),
            _late_cycles(process),
            joined(*([code(process["last_words"]), " "] if process["last_words"] else []), process["message"]),
        ]
        for process in document["processes"]
    ]
    headings = ("process", "starts", "ended", "loop [Hz]", "late cycles", "last line of output, and last status")
    return section("Processes", table(headings, rows, numbers=(1, 3, 4)))


def _late_cycles(process: ProcessDocument) -> Html | str:
    if process["overruns"] is None:
        return ""
    return joined(f"{process['overruns']}", *([" ", UNRELIABLE] if process["unreliable"] else []))


def _events(document: RunDocument) -> Section:
    rows = [[f"{event['at_s']:.1f} s", event["words"]] for event in document["events"]]
    return section("What happened", table(("after its start", "event"), rows) if rows else Html(""))
