"""The document of a run made by hand: robots that circle at different places, as `report.json` has it."""

import numpy as np

from cmr.experiments.live.run_document import RobotDocument, RunDocument

SECONDS = 20.0


def document(virtual: int, real: int = 1) -> RunDocument:
    """A run of some robots for 20 s, the real ones first; each drives a circle of 0.5 m around a place of its own."""
    return {
        "schema": 1,
        "scenario": "circles",
        "about": "Robots drive circles.",
        "began": "2026-01-01T00:00:00Z",
        "seconds": SECONDS,
        "ended_by": "the time was up",
        "failed": False,
        "seed": 1,
        "metrics": {"distance_driven": 5.0},
        "minimum_separation_m": 0.3,
        "nearest_robots": [0, 1],
        "nearest_at_s": 3.2,
        "distance_driven_m": 5.0,
        "waypoints_reached": False,
        "worlds": 1000,
        "world_rate_hz": 50.0,
        "unreliable": "the computer was late",
        "overruns": 0,
        "restarts": 0,
        "obstacles": {"discs": ((2.0, 1.0, 0.5),), "walls": ((-4.0, -3.0, 4.0, -3.0),)},
        "geofence": ((-8.0, -6.0), (8.0, -6.0), (8.0, 6.0), (-8.0, 6.0)),
        "robots": [_robot(number, "real" if number < real else "virtual") for number in range(real + virtual)],
        "processes": [
            {
                "name": "sim",
                "command": ["cmr-sim"],
                "starts": 1,
                "ends": ["stopped normally"],
                "last_words": "ready",
                "loop_rate_hz": 50.0,
                "overruns": 2,
                "unreliable": True,
                "message": "ready",
            }
        ],
        "events": [{"at_s": 1.0, "words": "all robots were ready"}],
    }


def _robot(number: int, kind: str) -> RobotDocument:
    time = np.linspace(0.0, SECONDS, 201)
    x, y = np.random.default_rng(number).uniform((-6.0, -4.0), (6.0, 4.0))
    return {
        "id": number,
        "kind": kind,
        "behaviour": "circle",
        "distance_m": 5.0,
        "waypoints": ((float(x), float(y)),),
        "waypoints_left": 0,
        "goal_reached_at_s": 12.0,
        "path": {
            "t": time.tolist(),
            "x": (x + 0.5 * np.cos(0.5 * time)).round(4).tolist(),
            "y": (y + 0.5 * np.sin(0.5 * time)).round(4).tolist(),
        },
    }
