"""In simulated time the driver calls the guard of the last gate, which then refuses just the same."""

from pathlib import Path

import pytest

from robot_driver.command_gate import CommandGate
from robot_driver.controllers import Request
from robot_driver.controllers.roboclaw import RoboClaw
from robot_driver.encoders import Wiring
from robot_driver.gate.messages import Reason
from robot_driver.host import THIS_COMPUTER
from robot_driver.last_gate import GateInProcess, GateProcess, Plan, gate_of
from robot_driver.simulated.drive import SimulatedDrive
from robot_driver.simulated.host import SimulatedHost
from tests.robot_driver.simulated.test_simulated_drive import logged

pytestmark = pytest.mark.slow

PLAN = Plan("roboclaw", Wiring(), 100.0, None)


def test_each_computer_has_the_gate_that_lives_in_its_time() -> None:
    assert isinstance(gate_of(PLAN, CommandGate(), THIS_COMPUTER), GateProcess)
    assert isinstance(gate_of(PLAN, CommandGate(), SimulatedHost()), GateInProcess)


@pytest.fixture
def gates(monkeypatch: pytest.MonkeyPatch) -> list[GateInProcess]:
    """The gates that are made."""
    made: list[GateInProcess] = []
    init = GateInProcess.__init__

    def noted(self: GateInProcess, plan: Plan, commands: CommandGate, host: SimulatedHost) -> None:
        init(self, plan, commands, host)
        made.append(self)

    monkeypatch.setattr(GateInProcess, "__init__", noted)
    return made


@pytest.mark.parametrize("controller", ["mbot", "roboclaw", "roboclaw-pair", "roboteq"])
def test_of_a_whole_drive_nothing_is_refused(tmp_path: Path, gates: list[GateInProcess], controller: str) -> None:
    messages = logged(SimulatedDrive(controller=controller, gyro=None, seconds=5.0), tmp_path)
    assert max(message.applied_left for message in messages["MOTOR_FEEDBACK_0"]) > 0.1
    (gate,) = gates
    assert gate.remarks() == []


def test_a_driver_that_sends_more_than_was_commanded_moves_nothing(
    tmp_path: Path, gates: list[GateInProcess], monkeypatch: pytest.MonkeyPatch
) -> None:
    drive = RoboClaw.drive

    def wrong(self: RoboClaw, first: float, second: float) -> Request[tuple[float, float]]:
        return drive(self, 1.0, 1.0) if first or second else drive(self, 0.0, 0.0)

    monkeypatch.setattr(RoboClaw, "drive", wrong)
    messages = logged(SimulatedDrive(gyro=None, seconds=5.0), tmp_path)
    assert {message.applied_left for message in messages["MOTOR_FEEDBACK_0"]} == {0.0}
    (gate,) = gates
    assert gate.refused[Reason.BEYOND] > 10
    assert "beyond" in gate.remarks()[0]
