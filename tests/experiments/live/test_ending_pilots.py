"""A pilot whose behaviour comes to an end is not started again: it would repeat its drive from wherever it is."""

from pathlib import Path

import pytest

from cmr.commands.scenarios import parse
from cmr.experiments.live.jobs import jobs_of
from cmr.processes.job import PILOT
from tests.support.small_teams import BELIEVED

TEXT = """
duration: 60
parameters: robot_0.yaml
geofence: [[-1, -1], [1, -1], [1, 1], [-1, 1]]
robots:
  - {{id: 0, kind: emulated, start: [0, 0], behaviour: {behaviour}}}
"""


@pytest.mark.parametrize(
    ("behaviour", "once"),
    [("investigate", True), ("manoeuvre", True), ("figure_eight", False)],
    ids=["investigate", "manoeuvre", "figure_eight"],
)
def test_only_a_drive_without_an_end_begins_again(behaviour: str, once: bool, tmp_path: Path) -> None:
    """So it is with an investigation, and with a manoeuvre."""
    BELIEVED.save(tmp_path / "robot_0.yaml")
    scenario = parse(TEXT.format(behaviour=behaviour), folder=tmp_path)
    [pilot] = [job for job in jobs_of(scenario, tmp_path, "udpm://239.255.76.67:7667?ttl=0") if job.role == PILOT]
    assert pilot.once == once
    assert any(argument.startswith("--geofence=") for argument in pilot.command)
