"""cmr-investigate without hardware: driver, serial line, controller, plant and sensors in simulated time."""

import json
from pathlib import Path

import pytest

from cmr.cli.errors import CommandError
from cmr.commands.investigating.command import main


@pytest.mark.slow
def test_what_is_hidden_in_an_emulated_robot_is_named(tmp_path: Path) -> None:
    """Through driver, serial line and controller the gyro's scale is found, and the story is written."""
    options = ["--emulated", "--ideal", "--hide", "gyro_scale", "--longest", "8", "--no-diagnosis"]
    assert main([*options, "--out", str(tmp_path)]) == 0
    story = json.loads((tmp_path / "investigation.json").read_text())
    assert story["named"] == ["gyro_scale"]
    assert story["story"]
    assert "gyro_scale" in (tmp_path / "investigation.html").read_text()


def test_what_is_for_an_emulated_robot_is_refused_for_a_real_one(tmp_path: Path) -> None:
    """Nothing can be hidden in a real robot, nor an emulated one; a folder that holds a run is not written over."""
    with pytest.raises(CommandError, match="real robot"):
        main(["--hide", "gyro_scale", "--out", str(tmp_path)])
    with pytest.raises(CommandError, match="always seen"):
        main(["--emulated", "--no-tracker", "--out", str(tmp_path)])
    (tmp_path / "run.lcm").write_bytes(b"")
    with pytest.raises(CommandError, match="holds a run already"):
        main(["--emulated", "--out", str(tmp_path)])
