"""A virtual robot investigates itself in simulated time, and what that takes is loaded before it drives."""

import subprocess
import sys

import pytest

from cmr.bus.streams import INVESTIGATION_STATUS, PARAMETERS
from cmr.investigation.behaviour import Investigate
from cmr.msg import investigation_status_t
from cmr.parameters.file import ParameterFile, Value
from cmr.parameters.following import ParameterFollower
from cmr.plant.parameters import TYPICAL
from cmr.world.telling import Telling
from cmr.world.world import VirtualRobot, World
from tests.investigation.investigated import SQUARE

pytestmark = pytest.mark.slow

ROBOT, EFFECT = 10, "coulomb_friction"
BEGIN, STEP = 1_700_000_000_000_000, 10_000  # us
OWN = {"wheel_radius": 0.04, "k2_over_k3": 118.0, "k1": 0.054, "base_width": 0.161}
LONGEST = 6.0  # s
# Which compiled functions a process has loaded is a matter of the process: it is counted in one of its own.
LOADED = """
from cmr.model import compiled
from tests.investigation.investigated import UNLIMITED, SQUARE, DrivenRobot
from cmr.investigation.behaviour import Investigate
from cmr.investigation.engine import Investigation, Planned
from cmr.investigation.floor import Floor
from cmr.investigation.movements import PERIOD, opening, waiting
from cmr.investigation.rehearsing import ROBOT
from cmr.parameters.file import ParameterFile, Value

names, load = [], compiled._Compiled._load
def counted(self):
    names.append(f"{self._module}.{self._name}")
    load(self)
compiled._Compiled._load = counted
Investigate().prepare()
first = len(names)
robot = DrivenRobot(ROBOT)
for left, right in (sides for part in opening() for sides in part.duty):
    robot.drive(float(left), float(right), PERIOD)
recording = robot.recording()
del names[:]
file = ParameterFile(0, {name: Value(value) for name, value in ROBOT.items()})
investigation = Investigation(file, Floor(SQUARE), limits=UNLIMITED)
investigation.opening(0.0, 0.0, 0.0)
decision = investigation.decide(recording, Planned.of(waiting(), int(recording.wheels.utime[-1])))
assert decision is not None and decision.choice.movement is not None
print(first, names)
"""


def follower(robot_id: int) -> ParameterFollower:
    """Return parameters of a robot with dry friction."""
    values = {name: Value(value) for name, value in {**OWN, **TYPICAL[EFFECT]}.items()}
    result = ParameterFollower(robot_id)
    announcement = ParameterFile(robot_id, values, effects=(EFFECT,)).announcement(sequence=1)
    result.handle(0, PARAMETERS.channel(robot_id), announcement)
    return result


def test_a_virtual_robot_finds_what_its_parameters_have_beyond_the_four() -> None:
    """Its sensors are what the world says of it; it tells all the while what is left."""
    behaviour = Investigate(longest=LONGEST)
    world = World([VirtualRobot(ROBOT, behaviour, ROBOT)], follower)
    world.view.geofence = SQUARE
    telling, told = Telling({ROBOT: behaviour}), []
    for step in range(round(3e6 * LONGEST) // STEP):
        world.advance(BEGIN + step * STEP)
        told += list(telling.messages(world.utime))
        if behaviour.finished:
            break
    assert behaviour.finished
    assert behaviour.problem == ""
    assert behaviour.driving is not None
    assert behaviour.driving.investigation.named == (EFFECT,)
    assert {(stream.name, robot_id) for stream, robot_id, _ in told} == {(INVESTIGATION_STATUS.name, ROBOT)}
    last = told[-1][2]
    assert isinstance(last, investigation_status_t)
    assert (last.state, last.named) == (investigation_status_t.DONE, f'["{EFFECT}"]')


def test_what_deciding_takes_is_loaded_before_the_robot_drives() -> None:
    """The first turn would else take the half second after which a drive counts as interrupted."""
    result = subprocess.run([sys.executable, "-c", LOADED], capture_output=True, text=True, check=True)
    first, names = result.stdout.split(maxsplit=1)
    assert int(first) > 5
    assert names.strip() == "[]"
