"""A drive by hand goes through the gates of a pilot, has an owner, can be stopped, and can be driven again."""

from pathlib import Path
from typing import Any

import pytest

from cmr.bus.claiming import Claim
from cmr.bus.messages import make
from cmr.bus.streams import COMMAND_OWNER, ESTOP, MOTOR_COMMAND, WORLD_STATE
from cmr.geometry.manoeuvres import TYPICAL, in_sequence
from cmr.geometry.manoeuvres.recorded import RecordedDriveError
from cmr.geometry.obstacles import Geofence
from cmr.model.motion import RobotState
from cmr.msg import command_claim_t, command_owner_t, estop_t, motor_command_t
from cmr.parameters.file import ParameterFile, Value
from cmr.parameters.following import ParameterFollower
from cmr.teleop import ByHand, Drive, Hands, Recorder
from cmr.teleop.hands import FASTER, STILL, STOP
from cmr.teleop.showing import frame
from cmr.world.owners import Owners
from cmr.world.pilot import Pilot
from cmr.world.view import VIRTUAL, Robot, world_messages

ROBOT, NOW = 10, 1_700_000_000_000_000
AHEAD = Hands(1.0, 0.0)
TRUE = ParameterFile(ROBOT, {name: Value(value) for name, value in TYPICAL.values.items()})


class Bench:
    """A virtual robot that is led by hand, without a bus: what is sent to it."""

    def __init__(self, folder: Path, geofence: Geofence | None = None) -> None:
        file = folder / f"robot_{ROBOT}.yaml"
        TRUE.save(file)
        hand = ByHand(speed=0.3, turn_rate=1.5)
        pilot = Pilot(ROBOT, hand, ParameterFollower(ROBOT, file), geofence=geofence, program="cmr-teleop")
        self.recorder = Recorder(folder / "drive.yaml")
        self.drive = Drive(pilot, hand, Claim("cmr-teleop", ROBOT, lambda: 7), self.recorder)
        self.utime, self.x = NOW, 0.0

    def turn(self, hands: Hands = AHEAD, times: int = 1, speed: float = 7.5) -> Any:
        """Let so many turns pass; return the last command, None where none was sent."""
        command = None
        for _ in range(times):
            self.utime += 20_000
            state = RobotState(self.x, 0.0, 0.0, speed, speed, 0.0, 0.0)
            (world,) = world_messages(self.utime, [Robot(self.utime, ROBOT, VIRTUAL, state)])
            self.drive.handle(self.utime, WORLD_STATE.name, world)
            sent = self.drive.turn(self.utime, hands, "")
            command = next((message for _, _, message in sent if isinstance(message, motor_command_t)), None)
            self.x += 0.006 * bool(command is not None and command.left)
        return command


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    return Bench(tmp_path)


def test_hands_become_the_duties_for_the_speed_that_was_asked_for(bench: Bench) -> None:
    command = bench.turn()
    assert command.left == command.right == pytest.approx(0.3 / TYPICAL.wheel_radius * TYPICAL.k1)
    turning = bench.turn(Hands(0.0, 1.0))
    assert turning.right == -turning.left == pytest.approx(1.5 * 0.5 * TYPICAL.base_width / 0.04 * TYPICAL.k1)
    bench.drive.request(bench.utime, FASTER)
    assert bench.turn().left == pytest.approx(1.1 * command.left)
    assert bench.turn(STILL).left == 0.0


def test_a_stop_is_engaged_at_once_repeated_and_holds_until_it_is_released(bench: Bench) -> None:
    assert bench.turn().left > 0.0
    bench.drive.request(bench.utime, STOP)
    sent = bench.drive.turn(bench.utime + 20_000, AHEAD, "")
    assert [stream.name for stream, _, _ in sent if stream is ESTOP] == ["ESTOP"]
    assert bench.drive.duties == (0.0, 0.0)
    assert "release of the emergency stop" in bench.drive.waiting_for
    for _, _, message in sent:
        bench.drive.handle(bench.utime, ESTOP.name, message)
    assert bench.turn(times=5).left == 0.0
    release = make(estop_t, utime=bench.utime + 1, engaged=False, source="Ada", reason="floor is clear")
    bench.drive.handle(bench.utime, ESTOP.name, release)
    assert bench.turn(times=20).left > 0.0


def test_nobody_is_commanded_whom_somebody_else_has(bench: Bench) -> None:
    owner = make(
        command_owner_t, utime=bench.utime, robot_id=ROBOT, sender=99, owner="cmr-pilot on lab1", since_utime=0
    )
    bench.drive.handle(bench.utime, COMMAND_OWNER.channel(ROBOT), owner)
    assert bench.turn() is None
    assert "cmr-pilot on lab1" in bench.drive.waiting_for
    assert bench.drive.end(bench.utime) == []


def test_a_virtual_robot_stays_in_its_geofence_without_poses(tmp_path: Path) -> None:
    bench = Bench(tmp_path, Geofence([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]))
    assert bench.turn(times=40).left > 0.0
    assert bench.turn(times=200).left == 0.0
    assert bench.x == pytest.approx(0.7 - 0.09, abs=0.1)
    assert "start cmr-teleop again" in bench.drive.pilot.left_fence


def test_the_end_of_a_drive_is_zero_and_leaves_the_robot_to_others(bench: Bench) -> None:
    bench.turn()
    *zeros, (_, _, claim) = bench.drive.end(bench.utime)
    assert {stream.name for stream, _, _ in zeros} == {MOTOR_COMMAND.name}
    assert claim.action == command_claim_t.END  # type: ignore[attr-defined]


def test_a_virtual_robot_that_ignores_commands_is_reported(bench: Bench) -> None:
    bench.turn(times=100, speed=0.0)
    assert "--virtual 10=commanded" in bench.drive.waiting_for


def test_the_screen_shows_what_the_robot_does_and_fits_any_terminal(bench: Bench) -> None:
    bench.turn(times=5)
    shown = frame(bench.drive, "hold a key", bench.utime, (80, 24))
    for words in ("+0.30 m/s", "duty left", "not engaged", "geofence", "battery", "owner", "ready"):
        assert words in shown
    assert len(frame(bench.drive, "hold a key", bench.utime, (10, 5)).split("\n")) <= 4


def test_a_drive_can_be_driven_again_as_it_was(bench: Bench) -> None:
    driven = []
    for hands, times in ((STILL, 20), (AHEAD, 100), (Hands(0.5, 1.0), 50), (STILL, 30)):
        for _ in range(times):
            command = bench.turn(hands)
            driven.append((command.left, command.right))
    said = bench.recorder.finish(ROBOT, TYPICAL)
    assert f"manoeuvre,name={bench.recorder.path}" in said
    again = in_sequence(str(bench.recorder.path))
    duties = again.duties(TYPICAL)
    for k in range(20, 168):  # a second at rest comes first
        assert duties.at(1.0 + 0.001 + 0.02 * (k - 20)) == pytest.approx(driven[k], abs=0.003)
    assert again.space_for(TYPICAL) == pytest.approx(1.2 * bench.x + 0.2, abs=0.05)
    assert len(bench.recorder.path.read_text().splitlines()) < 40, "straight lines have two ends"


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ("knots: []", "at least one knot"),
        ("knots:\n- [0.1, 2.0, 0.0]", "line 4.*duties must be"),
        ("knots:\n- [0.1, 0.2, 0.0]\n- [0.1, 0.2, 0.0]", "line 5.*above 0.1 s"),
        ("nots: 3", "nots"),
    ],
)
def test_what_is_no_drive_is_refused_with_its_line(tmp_path: Path, wrong: str, words: str) -> None:
    path = tmp_path / "drive.yaml"
    path.write_text(f"schema: 1\nspace: 1.0\n{wrong}\n")
    with pytest.raises(RecordedDriveError, match=words):
        in_sequence(str(path))


class Clocks:
    def __init__(self) -> None:
        self.now = 1000.0

    def utime(self) -> int:
        return round(self.now * 1e6)

    def monotonic(self) -> float:
        return self.now


def test_a_virtual_robot_obeys_its_owner_alone_and_says_who_that_is() -> None:
    clocks = Clocks()
    owners = Owners([ROBOT], clocks)

    def takes(sender: int, robot_id: int = ROBOT) -> bool:
        command = make(motor_command_t, utime=clocks.utime(), robot_id=robot_id, left=0.1, right=0.1)
        return owners.takes(MOTOR_COMMAND.channel(robot_id), command, sender)

    def claim(sender: int, action: int) -> None:
        message = make(
            command_claim_t, utime=clocks.utime(), robot_id=ROBOT, action=action, claimant=f"process {sender}"
        )
        assert not owners.takes(f"COMMAND_CLAIM_{ROBOT}", message, sender)

    assert takes(1)
    assert list(owners.reports()) == []
    claim(1, command_claim_t.CLAIM)
    claim(2, command_claim_t.CLAIM)
    assert (takes(1), takes(2), takes(2, robot_id=0)) == (True, False, True)
    assert [report.owner for report in owners.reports()] == ["process 1"]
    assert "process 2 is refused" in owners.problem()
    claim(2, command_claim_t.TAKE_OVER)
    assert (takes(1), takes(2)) == (False, True)
    assert list(owners.news()) == ["robot 10: process 2 took over the robot from process 1"]
