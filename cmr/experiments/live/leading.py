"""The processes of `cmr demo --lead`: a person leads a virtual robot by hand, and emulated real robots follow it."""

import subprocess
import time

import numpy as np

from cmr.cli.errors import CommandError
from cmr.experiments.live.demonstrating import RATE, START_UP, Demonstration
from cmr.experiments.scenario.reading import shipped
from cmr.msg import process_status_t
from cmr.processes.children import our_command

LEADER = 10
SCENARIO = f"""\
about: A virtual robot that a person leads by hand; two real robots (here emulated) follow it
duration: 86400
parameters: {shipped()["line"].parent / "parameters" / "robot_0.yaml"}
robots:
  - {{id: {LEADER}, kind: virtual, behaviour: commanded, start: [0.6, 0.0, 0.0]}}
  - {{id: 0, kind: emulated, behaviour: {{name: follow, leader: {LEADER}, gap: 0.5}}, start: [0.0, 0.0, 0.0]}}
  - {{id: 1, kind: emulated, behaviour: {{name: follow, leader: 0, gap: 0.5}}, start: [-0.6, 0.0, 0.0]}}
"""
TAKEN_OVER = 1  # exit code of a cmr-teleop that was replaced by another one


class Leading(Demonstration):
    """The demonstration: `run` starts everything, gives cmr-teleop the terminal, and returns a summary of the drive."""

    def run(self, with_page: bool, hands: list[str], seconds: float | None) -> str:
        """Let a person drive for `seconds`, or until they stop; `hands` are further options of cmr-teleop."""
        self._start()
        if with_page:
            address, token = self._open_page()
            print(f"The world is at {address}, a joystick at {address}/drive#{LEADER} (token {token}).", flush=True)
        self._wait(self._ready, START_UP, "all robots")
        self._watch.begin()
        self._hand_over(hands, seconds)
        return self._summary()

    def _hand_over(self, hands: list[str], seconds: float | None) -> None:
        """Give cmr-teleop the terminal until it ends; if a page took over, wait for a signal."""
        command = [our_command("cmr"), "teleop", "--robot", str(LEADER), "--lcm-url", self._process.bus.url]
        command += ["--parameters", str(self._children.folder / "robot_0.yaml"), *hands]
        ends = time.monotonic() + seconds if seconds is not None else float("inf")
        teleop = subprocess.Popen(command)
        may_be_replaced, was_told = not hands, False
        try:
            for _utime in self._process.loop(rate_hz=RATE):
                self._process.dispatch(self._watch.handle)
                if failure := self._children.failed():
                    raise CommandError(failure)
                code = teleop.poll()
                if code not in (None, 0, TAKEN_OVER if may_be_replaced else None):
                    raise CommandError(f"cmr-teleop ended with exit code {code}.")
                if code == TAKEN_OVER and not was_told:
                    print("The keyboard does not drive any more. Ctrl-C ends the demonstration.", flush=True)
                    was_told = True
                if time.monotonic() >= ends or code == 0:
                    return
        finally:
            self._end(teleop)

    def _ready(self) -> bool:
        """Return whether all robots are in the world, and the pilots of the real ones drive after their leaders."""
        pilots = [status for status in self._watch.statuses.values() if status.process == "cmr-pilot"]
        driven = sum(robot.behaviour is not None for robot in self._scenario.with_driver)
        running = sum(status.state == process_status_t.RUNNING for status in pilots)
        return not self._watch.missing() and running == driven

    def _summary(self) -> str:
        """Return the distance driven by each robot, and the closest approach of two robots."""
        ways = dict(zip(self._watch.ids.tolist(), self._watch.distance.tolist(), strict=True))
        led = ways.pop(LEADER)
        followed = ", ".join(f"robot {robot_id} {way:.2f} m" for robot_id, way in sorted(ways.items()))
        nearest = self._watch.nearest.distance
        near = f" The smallest distance between two robots was {nearest:.2f} m." if np.isfinite(nearest) else ""
        return f"Robot {LEADER} was led for {led:.2f} m; behind it drove {followed}.{near}"
