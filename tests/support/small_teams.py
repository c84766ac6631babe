"""Small teams for tests of experiments: a leader on waypoints, and followers in line behind it."""

from pathlib import Path

from cmr.commands.scenarios import parse
from cmr.experiments.team.plan import Scenario
from cmr.parameters.file import ParameterFile, Value

# As long as nobody has calibrated them, all robots are believed to be like this.
BELIEVED = ParameterFile(
    0,
    {"wheel_radius": Value(0.04), "k2_over_k3": Value(90.0), "k1": Value(0.064), "base_width": Value(0.19)},
)
NUMBERS = {name: value.value for name, value in BELIEVED.values.items()}


LINE = """
duration: {duration}
parameters: robot_0.yaml
ends_when: waypoints_reached
robots:
  - {{id: 0, kind: emulated, behaviour: "figure_eight,laps=0,speed=0.3", waypoints: [[0, 0], [0.8, 0], [1.2, 0.6]]}}
  - {{id: 1, kind: virtual, start: [-0.4, 0.0], behaviour: "follow,leader=0,gap=0.4,speed=0.5"}}
  - {{id: 2, kind: virtual, start: [-0.8, 0.0], behaviour: "follow,leader=1,gap=0.4,speed=0.5"}}
"""


def line_of_three(folder: Path, duration: float = 8.0) -> Scenario:
    """Robot 0 leads through a bend of 1.6 m at 0.3 m/s, robots 1 and 2 follow 0.4 m apart."""
    BELIEVED.save(folder / "robot_0.yaml")
    return parse(LINE.format(duration=duration), folder=folder)
