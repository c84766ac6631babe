"""cmr-investigate without hardware: driver, serial line, controller, plant and sensors in simulated time."""

import json
from pathlib import Path

import pytest

from cmr.cli.errors import CommandError
from cmr.commands.investigating.command import main
from cmr.parameters.file import load


@pytest.mark.slow
def test_an_emulated_robot_is_calibrated_and_its_story_is_written(tmp_path: Path) -> None:
    """The parameters come within 3 % of the emulated robot's own, from beliefs that are 5 to 10 % off."""
    assert main(["--emulated", "--ideal", "--calibrate", "--longest", "8", "--out", str(tmp_path)]) == 0
    story = json.loads((tmp_path / "investigation.json").read_text())
    assert story["story"]
    assert "investigation" in (tmp_path / "investigation.html").read_text().lower()
    found = load(tmp_path / "robot_0.yaml")
    for name, true in {"k2_over_k3": 118.0, "k1": 0.054, "base_width": 0.161}.items():
        assert found.value(name) == pytest.approx(true, rel=0.03)


def test_what_is_for_an_emulated_robot_is_refused_for_a_real_one(tmp_path: Path) -> None:
    """Nothing can be hidden in a real robot; and a folder that holds a run is not written over."""
    with pytest.raises(CommandError, match="real robot"):
        main(["--hide", "gyro_scale", "--out", str(tmp_path)])
    (tmp_path / "run.lcm").write_bytes(b"")
    with pytest.raises(CommandError, match="holds a run already"):
        main(["--emulated", "--out", str(tmp_path)])
