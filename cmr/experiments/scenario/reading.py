"""Read and validate a scenario from a YAML file, or a shipped one by its name."""

import sys
from importlib.resources import files
from pathlib import Path

from cmr.bus.preflight import BusError, parse_udpm
from cmr.documents.document import DocumentError, Item, Section, read, read_file
from cmr.experiments.scenario.checks import check_noise, check_room, check_team, with_sources_of_parameters
from cmr.experiments.scenario.ending import check_ending, read_ending
from cmr.experiments.scenario.hardware import Hardware
from cmr.experiments.scenario.robots import read_path, read_points, read_robots
from cmr.experiments.team.metrics import UNITS
from cmr.experiments.team.plan import ROBOT_RADIUS, Scenario
from cmr.experiments.team.population import PopulationError, drawn_from
from cmr.geometry.obstacles import Geofence, ObstacleError, Obstacles
from cmr.geometry.places import Disc, Point, Wall

KEYS = (
    *("name", "about", "duration", "seed", "rate", "robots", "obstacles", "geofence", "metrics", "ends_when"),
    *("parameters", "population", "process_noise", "reaction", "robot_radius", "host", "lcm_url"),
)
SHIPPED = Path(str(files("cmr.experiments.scenario"))) / "shipped"
LONGEST = 604_800.0  # s; a week
LONGEST_REACTION = 0.5  # s
LARGEST_SEED = 2**63 - 1


class ScenarioError(DocumentError):
    """A scenario cannot be used; the text names file, line and key, and says what is allowed."""


def load(path: Path, hardware: Hardware, *, starts_checked: bool = True) -> Scenario:
    """Read a scenario from a YAML file; `hardware` knows the options of drivers and emulators.

    If robots continue from where they are, starts are not checked, since they need not be clear of each other, nor is
    process noise: a calibration may have written new parameters without it. Behaviours given as `module:Class` are also
    searched in the working folder. Raises ScenarioError naming file, line and key when it is missing, unreadable or
    wrong.
    """
    if "" not in sys.path:
        sys.path.append("")
    return _scenario(read_file(path, ScenarioError), path.parent, hardware, starts_checked)


def parse(
    text: str,
    hardware: Hardware,
    source: str = "scenario.yaml",
    folder: Path = Path(),
    *,
    starts_checked: bool = True,
) -> Scenario:
    """Parse a scenario from a YAML text; `source` names it in errors, `folder` is where its files are.

    Raises ScenarioError naming line and key.
    """
    return _scenario(read(text, source, ScenarioError), folder, hardware, starts_checked)


def _scenario(document: Item, folder: Path, hardware: Hardware, starts_checked: bool) -> Scenario:
    root = document.section(KEYS)
    placed = read_robots(root.need("robots", "a list of robots"), folder, hardware)
    placed = with_sources_of_parameters(placed, read_path(root.get("parameters"), folder))
    discs, walls = _obstacles(root.get("obstacles"))
    radius = root.get("robot_radius")
    corners = read_points(fence, fewest=3) if (fence := root.get("geofence")) else None
    border = _geofence(corners, root)
    scenario = Scenario(
        name=_text(root, "name") or Path(document.place.source).stem,
        about=_text(root, "about") or "",
        duration=root.need("duration", "how long it takes at most, in s").number(0.1, LONGEST),
        robots=tuple(robot.plan for robot in placed),
        seed=seed.whole(0, LARGEST_SEED) if (seed := root.get("seed")) else 0,
        rate=rate.number(20.0, 100.0) if (rate := root.get("rate")) else Scenario.rate,
        discs=discs,
        walls=walls,
        geofence=corners,
        metrics=_metrics(root.get("metrics")),
        ends_when=read_ending(root.get("ends_when")),
        population=_population(root.get("population"), folder),
        process_noise=bool((noise := root.get("process_noise")) and noise.flag()),
        reaction=reaction.number(0.0, LONGEST_REACTION) if (reaction := root.get("reaction")) else 0.0,
        robot_radius=radius.number(0.001, 100.0) if radius else ROBOT_RADIUS,
        host=_text(root, "host"),
        lcm_url=_url(root.get("lcm_url")),
    )
    check_team(placed)
    if starts_checked:
        check_noise(scenario.robots, root.get("process_noise"))
        check_room(placed, scenario.robot_radius, discs, walls, border)
    check_ending(scenario, root.get("ends_when"))
    return scenario


def _text(root: Section, key: str) -> str | None:
    item = root.get(key)
    return item.text() if item else None


def _url(item: Item | None) -> str | None:
    if item is None:
        return None
    try:
        parse_udpm(item.text())
    except BusError as error:
        raise item.place.error(str(error)) from error
    return item.text()


def _obstacles(item: Item | None) -> tuple[tuple[Disc, ...], tuple[Wall, ...]]:
    if item is None:
        return (), ()
    section = item.section(("discs", "walls"))
    discs = [Disc(*entry.numbers("x y radius")) for entry in _list(section.get("discs"))]
    walls = [Wall(*entry.numbers("x1 y1 x2 y2")) for entry in _list(section.get("walls"))]
    try:
        Obstacles(discs, walls)
    except ObstacleError as error:
        raise item.place.error(str(error)) from error
    return tuple(discs), tuple(walls)


def _geofence(corners: tuple[Point, ...] | None, root: Section) -> Geofence | None:
    try:
        return Geofence(corners) if corners is not None else None
    except ObstacleError as error:
        raise root.need("geofence").place.error(str(error)) from error


def _list(item: Item | None) -> list[Item]:
    return item.items() if item else []


def _metrics(item: Item | None) -> tuple[str, ...]:
    if item is None:
        return tuple(UNITS)
    return tuple(dict.fromkeys(entry.word(tuple(UNITS)) for entry in item.items()))


def _population(item: Item | None, folder: Path) -> tuple[Path, ...]:
    """Return the files of a population, checked so that robots can be drawn from them."""
    paths = [path for entry in _list(item) if (path := read_path(entry, folder)) is not None]
    if item is not None and paths:
        try:
            drawn_from(paths, [], 0)
        except PopulationError as error:
            raise item.place.error(str(error)) from error
    return tuple(paths)


def shipped() -> dict[str, Path]:
    """Return the files of the shipped scenarios by name."""
    return {path.stem: path for path in sorted(SHIPPED.glob("*.yaml"))}


def path_of(name: str) -> Path:
    """Return the file of this path, or of the shipped scenario of this name.

    Raises ScenarioError if there is neither.
    """
    path = Path(name)
    if name in shipped() and not path.is_file():  # a folder of results may have the scenario's name
        return shipped()[name]
    if path.exists():
        return path
    raise ScenarioError(f"There is neither a file nor a shipped scenario {name!r}. Shipped: {', '.join(shipped())}.")
