"""The emulated robot whose processes are killed: with any controller, and with what its motors get at this moment."""

from contextlib import ExitStack
from pathlib import Path
from types import TracebackType

from robot_driver.emulator.devices import CONTROLLER_DEVICES
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.settings import load_settings
from robot_driver.terminals.pseudo_terminal import Ports
from tests.support.driver_bench import PunctualEngine

PORT = "motor"
STILL = (0.0, 0.0)  # duties
LEAST = 0.25  # duty of a robot that drives


class DrivenPlant(Plant):
    """A robot that notes which duties it was driven with last; forward is positive."""

    driven = STILL

    def command(self, left: float, right: float) -> None:
        """Give both motors these duties."""
        self.driven = (left, right)
        super().command(left, right)


class Robot:
    """A robot with a controller of this kind behind `folder`/motor; it is switched on as a context manager."""

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

    def drives(self) -> bool:
        """Return whether both motors get more than a little duty."""
        return min(self._plant.driven) > LEAST

    def stands(self) -> bool:
        """Return whether both motors get no duty."""
        return self._plant.driven == STILL
