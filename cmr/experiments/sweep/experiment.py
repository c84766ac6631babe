"""One run of a sweep: a scenario without hardware, faster than real time, scored as a row of numbers."""

import hashlib
import json
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from inspect import getfile
from pathlib import Path
from socket import gethostname
from threading import Lock

import cmr
from cmr.distribution import version
from cmr.experiments.scenario.ending import why_only_live
from cmr.experiments.sweep.journal import Result
from cmr.experiments.team.experiment import TeamRun, run
from cmr.experiments.team.hidden import Laboratory, believed_of
from cmr.experiments.team.plan import Scenario
from cmr.experiments.team.population import Population, PopulationError, population_of
from cmr.experiments.team.roles import Roles
from cmr.parameters.file import ParameterFile, ParameterFileError, load
from cmr.world.behaviours import AnyBehaviour, BehaviourError, make_behaviour

ONE_AT_A_TIME = Lock()  # two threads of a worker would compile the same code at once, which fails


class ExperimentError(Exception):
    """A scenario cannot be swept; the text gives the reason and the remedy."""


@dataclass(frozen=True)
class Experiment:
    """Everything a worker needs, including files, since it may be on another computer.

    `believed` is the parameter file used by all controllers; virtual robots also move with it, or draw their own
    parameters from `population`. `sources` is the digest of the CMR that planned it.
    """

    scenario: Scenario
    believed: ParameterFile
    population: Population | None
    sources: str


def experiment_of(scenario: Scenario) -> Experiment:
    """Return the experiment that a scenario describes, with its files read.

    Raises ExperimentError for an invalid file, robots with different parameter files, or features that only cmr-run
    supports.
    """
    _check(scenario)
    paths = sorted({robot.parameters for robot in scenario.robots if robot.parameters is not None})
    if len(paths) != 1:
        raise ExperimentError(
            f"{scenario.name}: a sweep needs one parameter file by which all robots steer, not {len(paths)} "
            f"({', '.join(map(str, paths)) or 'none'}). Name it as parameters; let robots differ by population."
        )
    try:
        population = population_of([load(path) for path in scenario.population]) if scenario.population else None
        return Experiment(scenario, load(paths[0]), population, sources_digest())
    except (ParameterFileError, PopulationError, OSError) as error:
        raise ExperimentError(f"{scenario.name}: {error}") from error


def _check(scenario: Scenario) -> None:
    for robot in scenario.robots:
        for what, given in (("behaviour", robot.behaviour), ("start", robot.start)):
            if given is None:
                raise ExperimentError(
                    f"{scenario.name}: robot {robot.robot_id} has no {what}; a sweep has nobody else to ask. "
                    f"Give it one: {what}, or --set robots.{robot.robot_id}.{what}=..."
                )
    only_live = why_only_live(scenario.ends_when)
    if only_live:
        raise ExperimentError(f"{scenario.name}: {only_live}.")


def perform(experiment: Experiment, seed: int) -> Result:
    """Return the metrics of one run [SI units], its computing time, and a digest of all paths.

    Real and emulated robots are moved by a plant that varies with robot and seed. Raises ImportError, naming the
    computer, if a behaviour available at planning is missing, or a different CMR is installed: results of two versions
    are not mixed.
    """
    if experiment.sources != sources_digest():
        raise ImportError(f"A worker on {gethostname()} has another CMR installed")
    try:
        _behaviours_of(experiment.scenario)
    except BehaviourError as error:
        raise ImportError(f"A worker on {gethostname()} cannot do the runs: {error}") from error
    scenario, believed = experiment.scenario, experiment.believed
    laboratory = Laboratory(believed_of(believed), seed=seed)
    drawn = experiment.population
    moves_by = {robot.robot_id: drawn.draw(seed, robot.robot_id) for robot in scenario.virtual} if drawn else {}
    real = [robot.robot_id for robot in scenario.with_driver]
    with ONE_AT_A_TIME:
        result = run(scenario, Roles(believed=believed, real=real, laboratory=laboratory, moves_by=moves_by), seed)
    metrics: dict[str, float | bool] = {
        name: float(result.metrics[name]) for name in scenario.metrics if name in result.metrics
    }
    if any(robot.waypoints for robot in scenario.robots):
        metrics["waypoints_reached"] = result.waypoints_reached
    return {**metrics, "simulated_time": float(result.time[-1]), "paths_sha256": _digest(result)}


def key_of(document: str, files: Iterable[Path], seed: int) -> str:
    """Return the key of a run: it depends on the scenario, its files, the seed and CMR itself."""
    contents = [hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted(files)]
    return hashlib.sha256(json.dumps([version(), sources_digest(), document, contents, seed]).encode()).hexdigest()[:32]


@cache
def sources_digest() -> str:
    """Return a digest of CMR's source files: results of a checkout that has changed since are not mixed."""
    paths = sorted(Path(cmr.__file__).parent.rglob("*.py"))
    return hashlib.sha256(b"".join(path.read_bytes() for path in paths)).hexdigest()


def files_of(scenario: Scenario) -> set[Path]:
    """Return the files that a scenario's runs depend on, including those of its behaviours."""
    parameters = {robot.parameters for robot in scenario.robots if robot.parameters is not None}
    sources = {Path(getfile(type(behaviour))) for behaviour in _behaviours_of(scenario)}
    return parameters | set(scenario.population) | sources


def _behaviours_of(scenario: Scenario) -> list[AnyBehaviour]:
    """Return one of each of the behaviours of a scenario.

    Raises BehaviourError for a missing one.
    """
    behaviours = {(plan.name, tuple(plan.settings.items())) for robot in scenario.robots if (plan := robot.behaviour)}
    return [make_behaviour(name, dict(settings)) for name, settings in behaviours]


def _digest(result: TeamRun) -> str:
    """Return a digest of all robots' trajectories: equal runs are equal to the last bit."""
    return hashlib.sha256(
        b"".join(part.tobytes() for part in (result.time, result.x, result.y, result.theta))
    ).hexdigest()
