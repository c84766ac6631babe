"""A scenario: a complete team experiment as plain values; `cmr.experiments.scenario` reads and validates it."""

from collections.abc import Mapping
from dataclasses import Field, dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Literal, Protocol

from cmr.experiments.team.metrics import UNITS
from cmr.geometry.obstacles import Geofence, Obstacles
from cmr.geometry.places import Disc, Point, Pose, Wall

ROBOT_RADIUS = 0.1  # m; the paper's robots are 0.16 m from wheel to wheel
Kind = Literal["real", "emulated", "virtual"]
KINDS: tuple[Kind, ...] = ("real", "emulated", "virtual")


@dataclass(frozen=True)
class BehaviourPlan:
    """A behaviour: its name or `module:Class`, and its settings as text, as for make_behaviour."""

    name: str
    settings: Mapping[str, str] = field(default_factory=dict)

    def __str__(self) -> str:
        """Return it as on a command line: `follow,leader=10,gap=0.5`."""
        return ",".join([self.name, *(f"{key}={value}" for key, value in self.settings.items())])

    @property
    def mapping(self) -> dict[str, object]:
        """The same as a mapping: `name` and the settings; a setting that is also called `name` is in `settings`."""
        others = {key: value for key, value in self.settings.items() if key != "name"}
        apart = {"settings": {"name": self.settings["name"]}} if "name" in self.settings else {}
        return {"name": self.name, **others, **apart}


class EmulatorPlan(Protocol):
    """The options of an emulated robot: the dataclass of cmr-emulate's options, as far as others use them."""

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]

    @property
    def command(self) -> str:
        """What kind of command the robot takes."""
        ...

    @property
    def controller(self) -> str:
        """The kind of its motor controller."""
        ...

    @property
    def gyro(self) -> str:
        """The kind of its gyro."""
        ...

    @property
    def settings(self) -> Path | None:
        """The file with settings that differ from the default robot."""
        ...


class BridgePlan(Protocol):
    """The options of a robot that speaks ROS 2: the dataclass of cmr-ros2's options for one robot."""

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]

    def kept_in(self, path: Path) -> "BridgePlan":
        """Return a copy whose profile is copied to `path`, unless it is shipped with CMR. Raises OSError."""
        ...

    def arguments(self, robot_id: int) -> list[str]:
        """Return the options of cmr-ros2 for this robot."""
        ...


@dataclass(frozen=True)
class RobotPlan:
    """One robot.

    `parameters` is its own parameter file. Without one, a virtual robot uses the current parameters of robot
    `parameters_of`; every virtual robot has one of the two. `start` is None only for a real robot, which begins where
    it stands. `host` None means the machine on which cmr-run is started.
    """

    robot_id: int
    kind: Kind
    behaviour: BehaviourPlan | None = None
    parameters: Path | None = None
    parameters_of: int | None = None
    start: Pose | None = None
    waypoints: tuple[Point, ...] = ()
    driver: object | None = None  # the dataclass of the options of cmr-driver
    ros2: BridgePlan | None = None
    emulator: EmulatorPlan | None = None
    calibrate: bool = False
    diagnose: bool = False
    range_sensor: bool = False
    host: str | None = None


@dataclass(frozen=True)
class Ending:
    """Ends a run before its duration is over: all waypoints reached, or a metric beyond a bound.

    Bounds are in the unit of the metric in `cmr.experiments.team.metrics`. The metric is evaluated from `after` [s] on,
    counted since all were ready, over the last `over` [s]; None: over the whole run so far.
    """

    waypoints_reached: bool = False
    metric: str | None = None
    below: float | None = None
    above: float | None = None
    after: float = 0.0
    over: float | None = None


@dataclass(frozen=True)
class Scenario:
    """A team experiment.

    `duration` [s] is the longest duration, `ends_when` may end it earlier. `rate` [Hz] is that of WORLD_STATE.
    `geofence` is the polygon [m; world frame] that real robots must not leave, or None. `metrics` are measured for the
    team. Virtual robots draw their parameters from the robots of the files `population`, if given; their decisions take
    effect `reaction` [s] later. `robot_radius` [m] is the size of robots at the start. `host` is the machine of
    simulation and log; None: the one on which cmr-run is started.
    """

    name: str
    duration: float
    robots: tuple[RobotPlan, ...]
    about: str = ""
    seed: int = 0
    rate: float = 50.0
    discs: tuple[Disc, ...] = ()
    walls: tuple[Wall, ...] = ()
    geofence: tuple[Point, ...] | None = None
    metrics: tuple[str, ...] = tuple(UNITS)
    ends_when: Ending = field(default_factory=Ending)
    population: tuple[Path, ...] = ()
    process_noise: bool = False
    reaction: float = 0.0
    robot_radius: float = ROBOT_RADIUS
    host: str | None = None
    lcm_url: str | None = None

    def robot(self, robot_id: int) -> RobotPlan | None:
        """Return the robot of this id, None if there is none."""
        return next((robot for robot in self.robots if robot.robot_id == robot_id), None)

    @property
    def obstacles(self) -> Obstacles:
        """The discs and walls together. Raises ObstacleError for an invalid one."""
        return Obstacles(self.discs, self.walls)

    @property
    def fence(self) -> Geofence | None:
        """The geofence with its geometry, None without one. Raises ObstacleError for an invalid one."""
        return Geofence(self.geofence) if self.geofence is not None else None

    @property
    def with_driver(self) -> tuple[RobotPlan, ...]:
        """The robots with a driver: real and emulated ones."""
        return tuple(robot for robot in self.robots if robot.kind != "virtual")

    @property
    def virtual(self) -> tuple[RobotPlan, ...]:
        """The virtual robots."""
        return tuple(robot for robot in self.robots if robot.kind == "virtual")
