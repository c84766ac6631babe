"""Load the compiled model in the background: the first compilation takes some seconds."""

import time
from collections.abc import Iterable
from threading import Lock, Thread

import numpy as np

from cmr.model.motion import RobotState
from cmr.model.parameters import RobotParameters
from cmr.world.behaviours import AnyBehaviour
from cmr.world.fleet import STEP, Fleet
from cmr.world.view import VIRTUAL

LONG = 1.0  # s; loading for longer is reported

Key = tuple[tuple[str, float], ...]


class Loader:
    """Loads what is needed to simulate robots with certain parameters and behaviours.

    While `is_held`, loading does not begin: otherwise a caller that compiles everything at first use would compile it
    twice.
    """

    def __init__(self, behaviours: Iterable[AnyBehaviour] = ()) -> None:
        self.is_held = False
        self._behaviours = list({id(behaviour): behaviour for behaviour in behaviours}.values())
        self._threads: dict[Key, Thread] = {}
        self._since: float = 0.0
        self._ready: set[Key] = set()
        self._simulated: list[RobotParameters] = []
        self._failure = ""
        self._one_at_a_time = Lock()

    def ready(self, parameters: RobotParameters) -> bool:
        """Return whether robots with these parameters can be simulated without delay; if not, start loading."""
        key = tuple(sorted(parameters.values.items()))
        if key not in self._threads:
            if self.is_held:
                return False
            self._since = time.monotonic()
            self._threads[key] = Thread(target=self._load, args=(key, parameters), daemon=True)
            self._threads[key].start()
        return key in self._ready

    @property
    def is_starting(self) -> bool:
        """Whether no robot can be simulated yet, but will be: this simulator is not ready."""
        return not self._ready and self._is_loading

    @property
    def _is_loading(self) -> bool:
        return any(thread.is_alive() for thread in self._threads.values())

    @property
    def message(self) -> str:
        """Why robots cannot be simulated with the newest parameters yet; empty if there is no long delay."""
        if self._is_loading and time.monotonic() - self._since > LONG:
            return (
                "The robot model is still being loaded. Code for effects that are new on this computer is compiled "
                "first, which takes about 20 s. Virtual robots do not move yet."
            )
        return self._failure

    def _load(self, key: Key, parameters: RobotParameters) -> None:
        """Simulate one robot with these parameters and prepare the behaviours, which loads all compiled code.

        Each set of laws is a model of its own, so it is also simulated together with those loaded before.
        """
        try:
            with self._one_at_a_time:
                self._prepare_behaviours()
                for together in ([parameters], [*self._simulated, parameters]) if self._simulated else ([parameters],):
                    _simulate(together)
                self._simulated.append(parameters)
        except Exception as error:  # any exception: effects of other packages are arbitrary code
            self._failure = f"Robots cannot be simulated by the newest parameters: {error}"
            return
        self._ready.add(key)
        self._failure = ""

    def _prepare_behaviours(self) -> None:
        """Prepare each behaviour once, before any robot may be simulated, so that none has to decide meanwhile."""
        while self._behaviours:
            self._behaviours.pop().prepare()


def _simulate(robots: list[RobotParameters]) -> None:
    """Simulate one step of a robot with each of these parameters."""
    fleet = Fleet()
    for robot_id, parameters in enumerate(robots):
        fleet.place([(robot_id, VIRTUAL)], RobotState.at_rest(np.zeros(1)), parameters)
        fleet.command(robot_id, [(0.0, 0.0)])
    fleet.advance(STEP)
