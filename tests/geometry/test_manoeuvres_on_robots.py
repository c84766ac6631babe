"""A leader and a real robot drive manoeuvres, and stop where driving blindly is not safe."""

from pathlib import Path

import numpy as np
import pytest

from cmr.bus.streams import WORLD_STATE
from cmr.cli.errors import CommandError
from cmr.commands.pilot import main as run_pilot
from cmr.commands.robots import behaviour_of, described_robots, numbered
from cmr.geometry.manoeuvres import TYPICAL, in_sequence
from cmr.model.motion import RobotState
from cmr.model.parameters import RobotParameters
from cmr.parameters.file import ParameterFile, Value
from cmr.parameters.following import ParameterFollower
from cmr.recordings.commanding import asked_by
from cmr.world.behaviours import Behaviour, BehaviourError, make_behaviour
from cmr.world.behaviours.manoeuvring import DriveManoeuvre
from cmr.world.pilot import Pilot
from cmr.world.view import REAL, Robot, WorldView, world_messages
from cmr.world.world import World
from tests.geometry.driven_manoeuvres import DT, LARGE, duties_of, motion_of

EPOCH = 1_800_000_000_000_000  # us
PARAMETERS = ParameterFile(0, {name: Value(value) for name, value in TYPICAL.values.items()})


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "robot_0.yaml"
    PARAMETERS.save(path)
    return path


def test_a_virtual_leader_drives_a_manoeuvre(file: Path) -> None:
    [leader] = described_robots([numbered("10=manoeuvre,name=spins,start=0,x=0.5")], parameters_of=0)
    world = World([leader], lambda robot_id: ParameterFollower(robot_id, file))
    headings, places = [], []
    for k in range(round(duties_of("spins")[0][-1] / DT)):
        world.advance(EPOCH + k * 10_000)
        for robot in world.robots():
            headings.append(robot.state.theta)
            places.append((robot.state.x, robot.state.y))
    expected = motion_of("spins").theta
    assert np.unwrap(headings).max() == pytest.approx(expected.max(), rel=1e-3)
    assert np.unwrap(headings).min() == pytest.approx(expected.min(), abs=0.01)
    assert np.abs(np.array(places) - (0.5, 0.0)).max() < 1e-6


class TestPilot:
    """A real robot is driven by the same behaviour, and stopped for good where driving blindly is not safe."""

    @pytest.fixture
    def behaviour(self) -> DriveManoeuvre:
        return DriveManoeuvre("steps", start=0.5)

    @pytest.fixture
    def pilot(self, behaviour: DriveManoeuvre, file: Path) -> Pilot:
        return Pilot(0, behaviour, ParameterFollower(0, file))

    @staticmethod
    def command(pilot: Pilot, seconds: float, x: float = 0.0) -> tuple[float, float]:
        """Return what the pilot commands with the robot at `x` [m]."""
        utime = EPOCH + round(seconds * 1e6)
        [message] = world_messages(utime, [Robot(utime, 0, REAL, RobotState.at_rest(x))])
        pilot.handle(utime, WORLD_STATE.name, message)
        return asked_by(pilot.command(utime))

    def test_drives_the_manoeuvre_to_its_end(self, pilot: Pilot, behaviour: DriveManoeuvre) -> None:
        steps = in_sequence("steps").duties()
        for time in np.arange(0.0, steps.duration + 0.5, 0.02):
            assert not behaviour.finished
            assert self.command(pilot, time) == pytest.approx(steps.at(time - 0.5), abs=1e-6)
        assert self.command(pilot, steps.duration + 0.52) == (0.0, 0.0)
        assert (behaviour.finished, behaviour.problem) == (True, "")

    def test_stops_for_good_outside_its_space(self, pilot: Pilot, behaviour: DriveManoeuvre) -> None:
        assert self.command(pilot, 0.0, x=5.0) == (0.0, 0.0)
        for time in np.arange(0.05, 2.0, 0.1):
            assert any(self.command(pilot, time, x=5.0)) == (time > 1.5)
        assert self.command(pilot, 2.1, x=5.9) == (0.0, 0.0)
        assert self.command(pilot, 2.2, x=5.0) == (0.0, 0.0)
        assert behaviour.finished
        assert "0.90 m from where it began; 0.80 m are allowed" in behaviour.problem

    def test_stops_for_good_when_it_was_interrupted(self, pilot: Pilot, behaviour: DriveManoeuvre) -> None:
        self.command(pilot, 0.0)
        for time in (2.0, 2.02):
            assert self.command(pilot, time) == (0.0, 0.0)
        assert behaviour.finished
        assert behaviour.problem == "steps was interrupted for 2.0 s. Start it again."

    def test_a_larger_robot_gets_more_space_and_people_may_allow_other(self) -> None:
        for given, allowed in ((None, 0.8 * 1.0 / 0.161), (0.4, 0.4)):
            behaviour = DriveManoeuvre("steps", space=given)
            me = Robot(EPOCH, 0, REAL, RobotState.at_rest())
            behaviour.command(EPOCH, me, WorldView(), LARGE)
            assert behaviour.space == pytest.approx(allowed)


class Brief(Behaviour):
    """A behaviour that is over at once."""

    def __init__(self, trouble: int = 0) -> None:
        self.finished = True
        self.problem = "The floor is wet. Wait." if trouble else ""

    def command(self, _utime: int, _me: Robot, _world: WorldView, _parameters: RobotParameters) -> tuple[float, float]:
        return 0.0, 0.0


def test_the_pilot_ends_with_its_behaviour(url: str, file: Path) -> None:
    options = ["--lcm-url", url, "--parameters", str(file)]
    assert run_pilot([*options, "--behaviour", "tests.geometry.test_manoeuvres_on_robots:Brief"]) == 0
    with pytest.raises(CommandError, match="The floor is wet"):
        run_pilot([*options, "--behaviour", "tests.geometry.test_manoeuvres_on_robots:Brief,trouble=1"])


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"name": "waltz"}, "no manoeuvre 'waltz'; there are straight_runs, spins"),
        ({"name": "spins+"}, "no manoeuvre ''"),
        ({"speed": "0"}, "speed must be above 0"),
        ({"speed": "2"}, "up to 1.1"),
        ({"repeats": "0"}, "repeats 1 to 100"),
        ({"space": "-1"}, "space above 0"),
        ({"start": "soon"}, "start=soon is not a number"),
    ],
)
def test_a_wrong_setting_is_named_with_what_is_allowed(settings: dict[str, str], said: str) -> None:
    with pytest.raises(BehaviourError, match=said):
        make_behaviour("manoeuvre", settings)


def test_a_description_on_the_command_line_is_a_manoeuvre() -> None:
    behaviour, pose = behaviour_of("manoeuvre,name=rest+spins,repeats=2,speed=0.5,theta=1")
    assert isinstance(behaviour, DriveManoeuvre)
    assert behaviour.manoeuvre.name == "rest+spins+rest+spins"
    assert pose == {"theta": 1.0}
