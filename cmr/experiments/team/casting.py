"""What an experiment needs of a scenario, and who plays which part in it: who is real, and who moves by what.

The protocols say what is read of `cmr.experiments.scenario`, which knows this room and must not be known by it.
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
        """What `make_behaviour` knows it by."""

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
        """What it does."""

    @property
    def start(self) -> tuple[float, float, float] | None:
        """Where it starts [m, m, rad]."""

    @property
    def waypoints(self) -> Sequence[tuple[float, float]]:
        """The path it is given [m]."""


class ScenarioLike(Protocol):
    """As `cmr.experiments.scenario.reading.Scenario`."""

    @property
    def robots(self) -> Sequence[RobotLike]:
        """The team."""

    @property
    def duration(self) -> float:
        """How long the experiment takes at most [s]."""

    @property
    def discs(self) -> Sequence[tuple[float, float, float]]:
        """Round obstacles: x, y, radius [m]."""

    @property
    def walls(self) -> Sequence[tuple[float, float, float, float]]:
        """Straight walls: x1, y1, x2, y2 [m]."""

    @property
    def geofence(self) -> Sequence[tuple[float, float]] | None:
        """The polygon [m] that real robots must not leave; None where there is none."""

    @property
    def process_noise(self) -> bool:
        """Whether virtual robots stray from their models as the parameter file says."""

    @property
    def reaction(self) -> float:
        """How much later than they decide virtual robots act [s]."""

    @property
    def ends_when(self) -> EndingLike:
        """What ends it before."""


@dataclass(frozen=True)
class Cast:
    """Who is who in an experiment.

    `believed` is the parameter file by which everybody steers. `real` are the ids of the real robots, whose physics
    `laboratory` hides. Of the others, each moves by its parameters in `moves_by`, or by those believed.
    """

    believed: ParameterFile
    real: Collection[int]
    laboratory: Laboratory
    moves_by: Mapping[int, RobotParameters] = field(default_factory=dict)
