"""Roles in an experiment: which robots are real, and which parameters move the others."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

from cmr.experiments.team.hidden import Laboratory
from cmr.model.parameters import RobotParameters
from cmr.parameters.file import ParameterFile


@dataclass(frozen=True)
class Roles:
    """The roles of the robots in an experiment.

    `believed` is the parameter file used by all controllers. `real` are the ids of the real robots, whose true
    parameters are in `laboratory`. Other robots move with their parameters in `moves_by`, or with the believed ones.
    """

    believed: ParameterFile
    real: Collection[int]
    laboratory: Laboratory
    moves_by: Mapping[int, RobotParameters] = field(default_factory=dict)
