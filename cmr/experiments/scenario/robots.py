"""Robots of a scenario as described in its file: individually, or many at once."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple, cast

from cmr.cli.configuration import LARGEST_ROBOT_ID
from cmr.documents.document import DocumentError, Item, Place, Section
from cmr.experiments.scenario.hardware import Hardware
from cmr.experiments.scenario.starts import starts_of
from cmr.experiments.team.plan import KINDS, BehaviourPlan, EmulatorPlan, Kind, RobotPlan
from cmr.geometry.places import Point
from cmr.world.behaviours import BehaviourError, make_behaviour

KEYS = (
    *("id", "count", "first_id", "kind", "behaviour", "parameters", "parameters_of", "start", "waypoints"),
    *("driver", "ros2", "emulator", "calibrate", "diagnose", "range_sensor", "host"),
)
MOST_ROBOTS = 100_000
PREVIOUS = "previous"  # as a setting's value: the id before the robot's own


class Placed(NamedTuple):
    """A robot, and its place in the file."""

    plan: RobotPlan
    place: Place


def read_robots(item: Item, folder: Path, hardware: Hardware) -> list[Placed]:
    """Return all robots of the list; files are named from `folder`.

    Raises ScenarioError for an invalid robot, a duplicate id, or an empty list.
    """
    placed: list[Placed] = []
    for entry in item.items():
        placed += _read_entry(entry.section(KEYS), folder, hardware)
        if len(placed) > MOST_ROBOTS:
            raise entry.place.error(f"there are more than {MOST_ROBOTS} robots")
    if not placed:
        raise item.place.error("must name one robot at least")
    _refuse_twins(placed)
    return placed


def _refuse_twins(placed: Sequence[Placed]) -> None:
    first: dict[int, Place] = {}
    for plan, place in placed:
        if plan.robot_id in first:
            line = first[plan.robot_id].line
            raise place.error(f"robot {plan.robot_id} is there twice: also in line {line}")
        first[plan.robot_id] = place


def _read_entry(section: Section, folder: Path, hardware: Hardware) -> list[Placed]:
    """Return the robots of one entry of the list."""
    ids = _ids(section)
    kind = cast(Kind, section.need("kind", "real, emulated or virtual").word(KINDS))
    _check_belonging(section, kind, ids)
    starts = starts_of(section.get("start"), len(ids), many="count" in section)
    behaviours = _behaviours(section, ids)
    parameters = read_path(section.get("parameters"), folder)
    parameters_of = section.get("parameters_of")
    whose = parameters_of.whole(0, LARGEST_ROBOT_ID) if parameters_of else None
    waypoints = read_points(section.get("waypoints"))
    driver = hardware.connection(connection) if (connection := section.get("driver")) else None
    bridge = hardware.bridging(bridged, folder) if (bridged := section.get("ros2")) else None
    emulator = _emulator(section.get("emulator"), folder, hardware) if kind == "emulated" else None
    calibrate, diagnose, host = section.get("calibrate"), section.get("diagnose"), section.get("host")
    range_sensor = section.get("range_sensor")
    return [
        Placed(
            RobotPlan(
                robot_id=robot_id,
                kind=kind,
                behaviour=behaviour,
                parameters=parameters,
                parameters_of=whose,
                start=None if kind == "real" and "start" not in section else start,
                waypoints=waypoints,
                driver=driver,
                ros2=bridge,
                emulator=emulator,
                calibrate=bool(calibrate and calibrate.flag()),
                diagnose=bool(diagnose and diagnose.flag()),
                range_sensor=bool(range_sensor and range_sensor.flag()),
                host=host.text() if host else None,
            ),
            section.place,
        )
        for robot_id, start, behaviour in zip(ids, starts, behaviours, strict=True)
    ]


def _ids(section: Section) -> range:
    """Return the id of one robot, or those of `count` robots from `first_id` on."""
    if "count" not in section:
        if "first_id" in section:
            raise section.place.error("first_id goes with count; one robot has an id")
        first = section.need("id", "a robot has an id; many have count and first_id").whole(0, LARGEST_ROBOT_ID)
        return range(first, first + 1)
    if "id" in section:
        raise section.place.error("id is for one robot; count goes with first_id")
    count = section.need("count").whole(1, MOST_ROBOTS)
    first = section.need("first_id", "the id of the first of them").whole(0, LARGEST_ROBOT_ID - count + 1)
    return range(first, first + count)


def _check_belonging(section: Section, kind: Kind, ids: range) -> None:
    """Raise ScenarioError for a missing or inapplicable key for this kind of robot."""
    if kind != "virtual" and len(ids) > 1:
        raise section.place.error(f"count is for virtual robots; describe each {kind} one with an id of its own")
    foreign = {
        "real": ("emulator", "parameters_of"),
        "emulated": ("driver", "ros2", "parameters_of"),
        "virtual": ("driver", "ros2", "emulator", "calibrate", "diagnose", "host"),
    }[kind]
    for key in foreign:
        item = section.get(key)
        if item is not None:
            raise item.place.error(f"is not for {kind} robots")
    if "ros2" in section and "driver" in section:
        raise section.place.error("driver and ros2 exclude each other: a robot has one or the other")
    if "ros2" in section and "host" in section:
        raise section.place.error(
            "host is not for robots with ros2: cmr-ros2 runs on this computer, and reaches others by range: subnet"
        )
    if "parameters" in section and "parameters_of" in section:
        raise section.place.error("parameters and parameters_of exclude each other: one of the two is enough")


def _behaviours(section: Section, ids: range) -> list[BehaviourPlan | None]:
    """Return the behaviour of each robot; `previous` in its settings is replaced by the id before its own."""
    item = section.get("behaviour")
    if item is None:
        return [None] * len(ids)
    template = _read_behaviour(item)
    if PREVIOUS not in template.settings.values():
        _check_behaviour(template, item.place)
        return [template] * len(ids)
    if ids[0] == 0:
        raise item.place.error(f"there is no robot before robot 0: {PREVIOUS} needs a first_id of 1 or more")
    plans = [
        BehaviourPlan(
            template.name, {key: str(own - 1) if v == PREVIOUS else v for key, v in template.settings.items()}
        )
        for own in ids
    ]
    _check_behaviour(plans[0], item.place)
    return list(plans)


def _read_behaviour(item: Item) -> BehaviourPlan:
    """Return a behaviour given as `name,key=value,...` or as a mapping with `name` and the settings.

    In a mapping, `settings` may hold those whose names collide with it: `name` of a manoeuvre.
    """
    if item.is_mapping:
        entries = dict(item.entries())
        if "name" not in entries:
            raise item.place.error("name is missing: the name of the behaviour")
        name, apart = entries.pop("name").text(), entries.pop("settings", None)
        entries |= dict(apart.entries()) if apart else {}
        return BehaviourPlan(name, {key: entry.text() for key, entry in entries.items()})
    name, *pairs = item.text().split(",")
    settings: dict[str, str] = {}
    for pair in pairs:
        key, equals, value = (part.strip() for part in pair.partition("="))
        if not equals or key in settings:
            fault = "is not of the form key=value" if not equals else f"gives {key} twice"
            raise item.place.error(f"{pair.strip()!r} {fault}; an example is follow,leader=10,gap=0.5")
        settings[key] = value
    return BehaviourPlan(name.strip(), settings)


def _check_behaviour(plan: BehaviourPlan, place: Place) -> None:
    """Raise ScenarioError unless the behaviour exists and accepts these settings."""
    try:
        make_behaviour(plan.name, dict(plan.settings))
    except BehaviourError as error:
        raise place.error(str(error)) from error
    except Exception as error:  # any exception: the class may be third-party code
        raise place.error(f"{plan.name} cannot be made: {type(error).__name__}: {error}") from error


def read_points(item: Item | None, fewest: int = 0) -> tuple[Point, ...]:
    """Return a list of points [x, y] in m."""
    points = [] if item is None else [element.numbers("x y") for element in item.items()]
    if item is not None and len(points) < fewest:
        raise item.place.error(f"must have {fewest} points or more, each [x, y]")
    return tuple((x, y) for x, y in points)


def read_path(item: Item | None, folder: Path) -> Path | None:
    """Return a file that exists, named from the folder of the scenario."""
    if item is None:
        return None
    path = folder / Path(item.text()).expanduser()
    try:
        is_file = path.is_file()
    except (OSError, ValueError):  # too long, or not a valid name
        is_file = False
    if not is_file:
        raise item.place.error(f"there is no file {path}; paths start from the folder of the scenario")
    return path


def _emulator(item: Item | None, folder: Path, hardware: Hardware) -> EmulatorPlan:
    """Return the emulation of a robot; its settings file is validated."""
    emulator = hardware.emulation(item)
    if item is None or emulator.settings is None:
        return emulator
    named = dict(item.entries())["settings"]
    path = read_path(named, folder)
    if path is not None:
        try:
            hardware.check_emulator(path)
        except DocumentError as error:
            raise named.place.error(str(error)) from error
    return replace(emulator, settings=path)
