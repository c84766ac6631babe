"""Logs of the real processes in real time: some emulated robots at once on one bus, an effect hidden in each."""

import subprocess
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import NamedTuple

import yaml

from robot_driver.emulator.settings import Settings
from tests.hidden_effects.chain import DRIVES, HARDWARE, IDEAL, ChainCase, Hidden, hidden_robot
from tests.support.private_bus import private_url

APART = 4.0  # m between the starts of two robots
WAITING = 90.0  # s more than the drive: for processes to start and to end


class RealTimeRun(NamedTuple):
    """The event log of a run, and what its robots 0, 1, ... are like."""

    log: Path
    robots: list[Settings]


def drive_in_real_time(cases: Sequence[ChainCase], folder: Path, robots: Sequence[Hidden] | None = None) -> RealTimeRun:
    """Drive one robot for each case, all at once; `robots` in place of those that the cases draw.

    Raises RuntimeError with what was printed where the run fails, ValueError for an effect that needs a place.
    """
    if any(case.effect == "surface_patch" for case in cases):
        raise ValueError("surface_patch: its place is found by driving, which takes simulated time")
    folder.mkdir(parents=True, exist_ok=True)
    hidden = robots or [hidden_robot(case, case.random) for case in cases]
    entries = [_robot(robot_id, case, hidden[robot_id], folder) for robot_id, case in enumerate(cases)]
    seconds = max(DRIVES[case.drive][2] for case in cases)
    scenario = folder / "scenario.yaml"
    scenario.write_text(yaml.safe_dump({"duration": seconds, "robots": entries}))
    command = [str(Path(sys.executable).parent / "cmr-run"), str(scenario)]
    command += ["--out", str(folder / "out"), "--lcm-url", private_url()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=seconds + WAITING, check=False)
    if done.returncode:
        raise RuntimeError(f"{' '.join(command)}: exit {done.returncode}\n{done.stdout}{done.stderr}")
    (log,) = (folder / "out").glob("*.lcm")
    return RealTimeRun(log, [settings for settings, _ in hidden])


def _robot(robot_id: int, case: ChainCase, hidden: Hidden, folder: Path) -> dict[str, object]:
    """Write the files of a robot, and return its entry in the scenario."""
    parameters, settings = folder / f"robot_{robot_id}.yaml", folder / f"emulator_{robot_id}.yaml"
    parameters.write_text(hidden.believed.to_yaml())
    settings.write_text(yaml.safe_dump(asdict(hidden.settings)))
    controller, gyro = HARDWARE[case.hardware]
    emulator = {"settings": settings.name, "controller": controller, "ideal": case.effect == IDEAL}
    behaviour, behaviour_settings, _ = DRIVES[case.drive]
    return {
        "id": robot_id,
        "kind": "emulated",
        "start": [APART * robot_id, 0.0],
        "parameters": parameters.name,
        "behaviour": {"name": behaviour, "settings": dict(behaviour_settings)},
        "emulator": emulator | ({"gyro": gyro} if gyro else {}),
    }
