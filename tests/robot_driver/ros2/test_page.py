"""The page "Bring your TurtleBot", line by line: from an emulated robot to its calibration."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from cmr.parameters.file import load
from tests.support.documentation_blocks import DOCS, Block, blocks_of
from tests.support.private_bus import private_url
from tests.support.ros2_python import environment, free_domain, ros2_python

# Calibration is compiled and computed here: a minute and more of a core. Others try the bridge in each run of CI.
pytestmark = [pytest.mark.waits, pytest.mark.further]
PATIENCE = 400.0  # s; the model may have to be compiled first, and this computer be busy
PAGE = DOCS / "how_to" / "bring_your_turtlebot.md"
EDITED = {
    "name: my robot": "my_robot.yaml",
    "robot_id: 0": "robot_0.yaml",
    "kind: real": "lab.yaml",
}  # files that the page shows, by a line
# test_scenario.py and test_process.py run the last ones.
NOT_HERE = ("pip ", "cmr-run ", "cmr-sim --virtual", "cmr-ros2 --virtual", "cmr-ros2 --show")


class Reader:
    """Somebody who does what the page says."""

    def __init__(self, folder: Path) -> None:
        self._python, self._folder = ros2_python(), folder
        self._environment = environment(private_url(), folder / "state") | {"ROS_DOMAIN_ID": str(free_domain())}
        self._running: list[tuple[str, subprocess.Popen[bytes]]] = []

    def read(self, block: Block) -> None:
        """Type the lines of a block, or edit the file that it shows."""
        if block.language == "yaml":
            name = next(name for line, name in EDITED.items() if line in block.text)
            (self._folder / name).write_text(block.text, encoding="utf-8")
        for line in block.text.splitlines() if block.language == "sh" else ():
            if not line.startswith(NOT_HERE):
                self._type(line.removesuffix(" &").split(), waits=not line.endswith(" &"))

    def end(self, program: str) -> None:
        """End a program that runs."""
        for name, process in self._running:
            if program in name and process.poll() is None:
                process.send_signal(signal.SIGINT)
                process.wait(PATIENCE)

    def close(self) -> None:
        """End all."""
        for name, _ in reversed(self._running):
            self.end(name)

    def _type(self, words: list[str], *, waits: bool) -> None:
        if words[0].startswith("cmr-"):
            command = [self._python, "-m", "cmr", words[0].removeprefix("cmr-"), *words[1:]]
        elif words[0] == "python3":
            command = [self._python, *words[1:]]
        else:
            command = [str(Path(sys.executable).parent / words[0]), *words[1:]]
        process = subprocess.Popen(command, cwd=self._folder, env=self._environment)
        self._running.append((" ".join(words), process))
        if waits:
            assert process.wait(PATIENCE) == 0, words
        elif words[0] == "cmr-sim":
            time.sleep(5.0)  # the pilot waits for the rest


def test_the_page_leads_from_a_robot_to_its_calibration(tmp_path: Path) -> None:
    (tmp_path / "state").mkdir()
    reader = Reader(tmp_path)
    try:
        for block in blocks_of(PAGE):
            if "cmr-calibrate" in block.text:
                reader.end("lcm-logger")
            reader.read(block)
    finally:
        reader.close()
    found = load(tmp_path / "found.yaml")
    # As the emulated robot is (robot_driver/emulator/default.yaml), which has noise and imperfections.
    assert found.value("base_width") == pytest.approx(0.161, rel=0.05)
    assert found.value("response_time") == pytest.approx(0.15, rel=0.2)
