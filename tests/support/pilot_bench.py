"""A pilot without a bus, and the messages that it gets."""

from pathlib import Path
from typing import Any

from cmr.bus.messages import make
from cmr.bus.streams import POSE, WORLD_STATE
from cmr.model.motion import RobotState
from cmr.model.parameters import RobotParameters
from cmr.msg import motor_command_t, pose_xyt_t
from cmr.parameters.file import ParameterFile, Value
from cmr.parameters.following import ParameterFollower
from cmr.world.behaviours import Behaviour
from cmr.world.pilot import Pilot
from cmr.world.view import REAL, Robot, WorldView, world_messages
from tests.support.emulated_drive import EPOCH, TRUTH
from tests.support.typed_messages import as_a

TRUE = ParameterFile(0, {"wheel_radius": Value(0.04)} | {name: Value(value) for name, value in TRUTH.items()})
PERIOD = 20_000  # us


class StraightOn(Behaviour):
    """Drives on with the same duties, whatever happens."""

    def __init__(self, left: float = 0.5, right: float = 0.5) -> None:
        self.duties = (left, right)

    def command(self, _utime: int, _me: Robot, _world: WorldView, _parameters: RobotParameters) -> tuple[float, float]:
        return self.duties


class Bench:
    """A pilot, and the messages that it gets."""

    def __init__(self, folder: Path, behaviour: Behaviour | None = None, **options: Any) -> None:
        file = folder / "robot_0.yaml"
        TRUE.save(file)
        self.pilot = Pilot(0, behaviour or StraightOn(), ParameterFollower(0, file), **options)
        self.utime = EPOCH

    def turn(
        self, x: float = 0.0, *, pose: bool = True, others: tuple[Robot, ...] = (), psi: float = 0.0
    ) -> tuple[float, float]:
        """Let 20 ms pass with the robot at (x, 0), turned to +x; return the duties commanded."""
        self.utime += PERIOD
        me = Robot(self.utime, 0, REAL, RobotState(x, 0.0, 0.0, psi, psi, 0.0, 0.0))
        for message in world_messages(self.utime, [me, *others]):
            self.pilot.handle(self.utime, WORLD_STATE.name, message)
        if pose:
            self.pose(x)
        command = as_a(motor_command_t, self.pilot.command(self.utime))
        return command.left, command.right

    def pose(self, x: float, age: int = 0) -> None:
        message = make(pose_xyt_t, utime=self.utime - age, robot_id=0, x=x, y=0.0, theta=0.0)
        self.pilot.handle(self.utime, POSE.channel(0), message)
