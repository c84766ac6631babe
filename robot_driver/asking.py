"""Send requests to a motor controller, and repeat unanswered ones."""

import threading
from dataclasses import replace
from typing import TypeVar

from robot_driver.controllers import BadReply, Controller, Request
from robot_driver.rhythm import Rhythm
from robot_driver.serial_port import Answer, PortLost, SerialPort

T = TypeVar("T")

ATTEMPTS = 3  # of a request whose answer matters more than the rhythm


class Asking:
    """Sends requests to the controller at a port.

    `faults` counts requests with a missing or wrong answer. While `doubtful`, a late reply to an earlier request may
    still arrive. `rhythm` receives the duration of each answer.
    """

    def __init__(self, port: SerialPort, controller_type: type[Controller], rhythm: Rhythm) -> None:
        self.faults = 0
        self.doubtful = False
        self._port = port
        self._controller_type = controller_type
        self._rhythm = rhythm

    def ask(self, request: Request[T]) -> Answer[T]:
        """Return the answer to a request. Raises BadReply where there is none."""
        asked = self._port.host.monotonic()
        answer = self._port.exchange(request)
        if request.data and not request.ends_in_silence:  # otherwise it was known already, or took a silence to know
            self._rhythm.round_trips.append(self._port.host.monotonic() - asked)
        return answer

    def insist(self, request: Request[T], stop: threading.Event, attempts: int = ATTEMPTS) -> T:
        """Return the answer to a request, repeating it when it fails.

        Raises PortLost when it fails every time, or when the process is ending.
        """
        for _ in range(attempts):
            if stop.is_set():
                raise PortLost("The process is ending.")
            try:
                return self.ask(_until(stop, request)).value
            except BadReply as bad:
                reason = str(bad)
                self.recover()
        raise PortLost(f"{self.silence()} Last failure: {reason}")

    def answers(self, controller: Controller) -> bool:
        """Return whether the controller answers at all; the motors are ordered to stop."""
        try:
            self.ask(controller.drive(0.0, 0.0))
        except BadReply:
            return False
        return True

    def recover(self) -> None:
        """Count a failed request, and resynchronise requests and answers."""
        self.faults += 1
        self.doubtful = True
        self._port.resynchronise()

    def reset(self, sign: str) -> str:
        """Return a sentence on a controller that was reset, as a `sign` shows."""
        return (
            f"The motor controller at {self._port.path} was reset: {sign}. Check its power supply; the motors start "
            f"again from zero."
        )

    def silence(self) -> str:
        """Return a sentence on a controller that does not answer."""
        return (
            f"The motor controller at {self._port.path} does not answer. Check its power, its cable, and that it is "
            f"set to {self._controller_type.link} at {self._port.baud_rate} baud."
        )


def _until(stop: threading.Event, request: Request[T]) -> Request[T]:
    """Return a request that is not waited for when the process is ending; some take longer than a second."""
    return replace(request, missing=lambda reply: 0 if stop.is_set() else request.missing(reply))
