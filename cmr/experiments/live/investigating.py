"""The processes of `cmr demo --investigate`: an emulated robot diagnoses its own hidden effects."""

import subprocess
from collections.abc import Sequence
from pathlib import Path

from cmr.cli.errors import CommandError
from cmr.experiments.live.demonstrating import RATE, START_UP, Demonstration
from cmr.processes.children import our_command

ROBOT = 0
FLOOR = "-1,-1,1,-1,1,1,-1,1"
FOUND = "found"  # folder of cmr-investigate's results
SCENARIO = f"""\
about: An emulated robot that finds out by itself what its model gets wrong
duration: 86400
parameters: {{parameters}}
robots:
  - id: {ROBOT}
    kind: emulated
    start: [0.0, 0.0, 0.0]
    emulator: {{{{settings: {{settings}}, ideal: {{ideal}}}}}}
"""


def scenario_text(parameters: Path, settings: Path, *, is_ideal: bool) -> str:
    """Return the scenario of a robot with believed `parameters`; the emulator's options are as in cmr-emulate."""
    return SCENARIO.format(parameters=parameters, settings=settings, ideal=str(is_ideal).lower())


class Investigating(Demonstration):
    """The demonstration: `run` starts everything, shows it on a page, and gives cmr-investigate the terminal."""

    def run(self, further: Sequence[str]) -> Path | None:
        """Return the folder with the results; None if a signal ended it. `further` are options of cmr-investigate.

        Raises CommandError if a process failed.
        """
        self._start()
        address, _token = self._open_page(f"--geofence={FLOOR}")
        print(f"Watch it at {address}", flush=True)
        self._wait(lambda: not self._watch.missing(), START_UP, "the robot")
        return self._investigate(further)

    def _investigate(self, further: Sequence[str]) -> Path | None:
        folder = self._children.folder
        command = [our_command("cmr-investigate"), "--robot", str(ROBOT), f"--floor={FLOOR}", *further]
        command += ["--parameters", str(folder / f"robot_{ROBOT}.yaml"), "--out", str(folder / FOUND)]
        investigation = subprocess.Popen([*command, "--lcm-url", self._process.bus.url])
        try:
            for _utime in self._process.loop(rate_hz=RATE):
                self._process.dispatch(self._watch.handle)
                if failure := self._children.failed():
                    raise CommandError(failure)
                code = investigation.poll()
                if code:
                    raise CommandError(f"cmr-investigate ended with exit code {code}. See {folder}/*.txt.")
                if code == 0:
                    return folder / FOUND
            return None
        finally:
            self._end(investigation)
