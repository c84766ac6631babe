"""The report of a run: `report.json` with all measurements, and `report.html`, a page."""

import json
import math
from datetime import datetime, timezone
from pathlib import Path

import numpy as np

from cmr.experiments.live.keeping_up import Pace, in_words, is_too_late, what_was_too_slow
from cmr.experiments.live.live_run import LiveRun, Outcome
from cmr.experiments.live.measuring import measure
from cmr.experiments.live.page import more_than, run_page
from cmr.experiments.live.run_document import PathDocument, ProcessDocument, RobotDocument, RunDocument
from cmr.experiments.live.watch import Floats, TeamWatch
from cmr.experiments.team.metrics import UNITS
from cmr.files import write_atomically
from cmr.processes.job import DRIVER, EMULATOR, PILOT, SIM
from cmr.processes.supervisor import State

SCHEMA = 1
MOST_POINTS = 200_000  # of all paths together
FEWEST_POINTS = 20  # of a path
MOVES_ROBOTS = (SIM, DRIVER, PILOT, EMULATOR)  # roles of time-critical processes


def write_report(run: LiveRun, outcome: Outcome, began: float, folder: Path) -> RunDocument:
    """Write report.json and report.html into a folder; `began` is the time of day [s since the epoch].

    Returns the contents of report.json.

    Raises OSError when they cannot be written.
    """
    document = document_of(run, outcome, began)
    write_atomically(json.dumps(document, allow_nan=False) + "\n", folder / "report.json")
    write_atomically(run_page(document), folder / "report.html")
    return document


def document_of(run: LiveRun, outcome: Outcome, began: float) -> RunDocument:
    """Return the measurements: lengths in m, times in s since all robots were ready."""
    watch, scenario = run.watch, run.scenario
    first = watch.first_utime or first_seen(watch)
    near = watch.nearest
    return {
        "schema": SCHEMA,
        "scenario": scenario.name,
        "about": scenario.about,
        "began": datetime.fromtimestamp(began, timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ"),
        "seconds": round(outcome.seconds, 3),
        "ended_by": outcome.ended_by,
        "failed": outcome.failed,
        "seed": scenario.seed,
        "metrics": metrics_of(run),
        "minimum_separation_m": _number(near.distance),
        "nearest_robots": list(near.robots) if near.utime else [],
        "nearest_at_s": (near.utime - first) * 1e-6 if near.utime else None,
        "distance_driven_m": _number(watch.measure("distance_driven")),
        "waypoints_reached": watch.waypoints_reached,
        "worlds": watch.worlds,
        "world_rate_hz": _number(mean_rate(watch)),
        "unreliable": in_words(what_was_too_slow(_paces(run), outcome.seconds, mean_rate(watch), scenario.rate)),
        "overruns": watch.overruns,
        "restarts": run.supervisor.restarts,
        "obstacles": {"discs": scenario.discs, "walls": scenario.walls},
        "geofence": scenario.geofence,
        "robots": _robots(run, first),
        "processes": _processes(run, outcome.seconds),
        "events": [{"at_s": round(at, 2), "words": words} for at, words in run.events],
    }


def metrics_of(run: LiveRun) -> dict[str, float]:
    """Return the metrics that the scenario asks for, in the units of `UNITS`, without undefined ones."""
    chosen = run.scenario.metrics
    measured = measure(run.scenario, run.watch, chosen)
    return {name: number for name in chosen if (number := _number(measured.get(name, math.nan))) is not None}


def metrics_in_words(document: RunDocument) -> str:
    """Return the metrics of a run as a person reads them; a goal that was not reached took longer than the run."""
    return ", ".join(
        f"{name.replace('_', ' ')} {more_than(name, document)}{value:.3g} {UNITS[name]}"
        f"{' (unreliable)' if document['unreliable'] else ''}"
        for name, value in document["metrics"].items()
    )


def first_seen(watch: TeamWatch) -> int:
    """Return when a robot was first seen [us]; 0 if none was."""
    return int(watch.track.utime[0]) if len(watch.track) else 0


def mean_rate(watch: TeamWatch) -> float:
    """Return the mean publishing rate of the world [Hz], since all were ready if they are."""
    if not len(watch.track):
        return 0.0
    span = (watch.utime - (watch.first_utime or first_seen(watch))) * 1e-6
    counted = watch.worlds if watch.first_utime else watch.worlds - 1
    return counted / span if span > 0.0 else 0.0


def _robots(run: LiveRun, first: int) -> list[RobotDocument]:
    watch = run.watch
    step = max(math.ceil(len(watch.track) / max(MOST_POINTS // len(watch.ids), FEWEST_POINTS)), 1)
    paths: Floats = watch.track.places[::step].astype(np.float64)
    seconds = np.asarray(watch.track.utime[::step] - first, dtype=np.float64) * 1e-6
    plans = {robot.robot_id: robot for robot in run.scenario.robots}
    remaining = watch.remaining_waypoints()
    return [
        {
            "id": robot_id,
            "kind": plans[robot_id].kind,
            "behaviour": str(plans[robot_id].behaviour or ""),
            "distance_m": _number(float(watch.distance[index])),
            "waypoints": plans[robot_id].waypoints,
            "waypoints_left": len(remaining.get(robot_id, ())),
            "goal_reached_at_s": (reached - first) * 1e-6 if (reached := watch.reached_utime.get(robot_id)) else None,
            "path": _path(seconds, paths[:, :, index]),
        }
        for index, robot_id in enumerate(watch.ids.tolist())
    ]


def _path(seconds: Floats, places: Floats) -> PathDocument:
    """Return times [s] and places [m] of a robot while it was seen."""
    seen = np.isfinite(places[:, 0])
    t, (x, y) = seconds[seen].round(2), places[seen].round(4).T
    return {"t": t.tolist(), "x": x.tolist(), "y": y.tolist()}


def _paces(run: LiveRun) -> list[Pace]:
    """Return the timing of the processes that move robots, as far as received."""
    states = (state for state in run.supervisor.states.values() if state.job.role in MOVES_ROBOTS)
    return [pace for state in states if (pace := _pace(run, state)) is not None]


def _pace(run: LiveRun, state: State) -> Pace | None:
    late = run.watch.late_turns(state.pid)
    return None if late is None else Pace(state.job.name, run.watch.loop_rate(state.pid), late)


def _processes(run: LiveRun, seconds: float) -> list[ProcessDocument]:
    rows: list[ProcessDocument] = []
    for name, state in run.supervisor.states.items():
        status, pace = run.watch.statuses.get(state.pid), _pace(run, state)
        rows.append(
            {
                "name": name,
                "command": state.job.command,
                "starts": state.starts,
                "ends": state.ends,
                "last_words": run.supervisor.last_words(name),
                "loop_rate_hz": _number(status.loop_rate_hz) if status else None,
                "overruns": run.watch.late_turns(state.pid),
                "unreliable": pace is not None and state.job.role in MOVES_ROBOTS and is_too_late(pace, seconds),
                "message": status.message if status else "",
            }
        )
    return rows


def _number(value: float) -> float | None:
    """Return a number for JSON, None if it is not finite."""
    return round(value, 4) if math.isfinite(value) else None
