"""The emulated robot whose processes are killed, with any motor controller; its current duties can be read."""

from contextlib import ExitStack
from pathlib import Path
from types import TracebackType

from robot_driver.emulator.devices import CONTROLLER_DEVICES
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.settings import load_settings
from robot_driver.terminals.pseudo_terminal import Ports
from tests.support.driver_bench import PunctualEngine

PORT = "motor"
STOPPED = (0.0, 0.0)  # duties
DRIVING_DUTY = 0.25  # a robot drives if both duties exceed this


class DrivenPlant(Plant):
    """A robot that remembers its last duties; forward is positive."""

    duties = STOPPED

    def command(self, left: float, right: float) -> None:
        """Set the duties of both motors."""
        self.duties = (left, right)
        super().command(left, right)


class Robot:
    """A robot whose controller is at the port `folder`/motor; a context manager that switches it on."""

    def __init__(self, folder: Path, controller: str) -> None:
        settings = load_settings().ideal()
        self._plant = DrivenPlant(settings)
        self._device = CONTROLLER_DEVICES[controller](settings, self._plant)
        self._folder = folder

    def __enter__(self) -> "Robot":
        with ExitStack() as stack:
            ports = stack.enter_context(Ports(self._folder, (PORT,)))
            stack.enter_context(PunctualEngine(self._plant, {PORT: self._device}, ports.terminals))
            self._on = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._on.close()

    def is_driving(self) -> bool:
        """Return whether both duties are clearly above zero."""
        return min(self._plant.duties) > DRIVING_DUTY

    def is_stopped(self) -> bool:
        """Return whether both duties are zero."""
        return self._plant.duties == STOPPED
