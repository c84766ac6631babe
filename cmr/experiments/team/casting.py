"""Roles in an experiment: which robots are real, and which parameters move the others.

The protocols describe the required part of `cmr.experiments.scenario`, which imports this package and must not be
imported.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from cmr.experiments.team.hidden import Laboratory
from cmr.model.parameters import RobotParameters
from cmr.parameters.file import ParameterFile


class EndingLike(Protocol):
    """As `cmr.experiments.scenario.plan.Ending`."""

    @property
    def waypoints_reached(self) -> bool:
        """Whether the experiment is over when all waypoints are reached."""


class BehaviourLike(Protocol):
    """As `cmr.experiments.scenario.plan.BehaviourPlan`."""

    @property
    def name(self) -> str:
        """The name for `make_behaviour`."""

    @property
    def settings(self) -> Mapping[str, str]:
        """Its settings, as texts."""


class RobotLike(Protocol):
    """As `cmr.experiments.scenario.plan.RobotPlan`."""

    @property
    def robot_id(self) -> int:
        """Its id."""

    @property
    def behaviour(self) -> BehaviourLike | None:
        """Its behaviour."""

    @property
    def start(self) -> tuple[float, float, float] | None:
        """Where it starts [m, m, rad]."""

    @property
    def waypoints(self) -> Sequence[tuple[float, float]]:
        """Its start pose [m, m, rad]."""


class ScenarioLike(Protocol):
    """As `cmr.experiments.scenario.reading.Scenario`."""

    @property
    def robots(self) -> Sequence[RobotLike]:
        """The team."""

    @property
    def duration(self) -> float:
        """The longest duration of the experiment [s]."""

    @property
    def discs(self) -> Sequence[tuple[float, float, float]]:
        """Round obstacles: x, y, radius [m]."""

    @property
    def walls(self) -> Sequence[tuple[float, float, float, float]]:
        """Straight walls: x1, y1, x2, y2 [m]."""

    @property
    def geofence(self) -> Sequence[tuple[float, float]] | None:
        """The polygon [m] that real robots must not leave; None without one."""

    @property
    def process_noise(self) -> bool:
        """Whether virtual robots deviate from their models as specified in the parameter file."""

    @property
    def reaction(self) -> float:
        """The delay of virtual robots' decisions [s]."""

    @property
    def ends_when(self) -> EndingLike:
        """The condition that ends it earlier."""


@dataclass(frozen=True)
class Cast:
    """The roles of the robots in an experiment.

    `believed` is the parameter file used by all controllers. `real` are the ids of the real robots, whose true
    parameters are in `laboratory`. Other robots move with their parameters in `moves_by`, or with the believed ones.
    """

    believed: ParameterFile
    real: Collection[int]
    laboratory: Laboratory
    moves_by: Mapping[int, RobotParameters] = field(default_factory=dict)
