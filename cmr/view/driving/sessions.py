"""Sessions of the joystick page: its messages go to a process of cmr-teleop.

Delayed messages are recognised by the old beats that they repeat, and move nothing (`cmr.teleop.remote`).
"""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Literal

import msgspec
from msgspec import UNSET, Meta, UnsetType
from websockets.typing import Data

from cmr.view.beside.sessions import Entering, Sessions, decoded
from cmr.view.entrance.guesses import Guesses

HTML = Path(__file__).with_name("drive.html")
MOST_DRIVERS = 4  # processes at once

Share = Annotated[float, Meta(ge=-1.0, le=1.0)]
Command = Callable[[int, bool], list[str]]  # of cmr-teleop, for a robot, which may be taken over


class DriveSaid(Entering, forbid_unknown_fields=True, frozen=True, omit_defaults=True):
    """One message: first tokens, then the robot to drive, then the joystick's position with each beat."""

    robot: Annotated[int, Meta(ge=0, le=2**31 - 1)] | UnsetType = UNSET
    take_over: bool = False
    beat: Annotated[int, Meta(ge=0, le=2**53)] | UnsetType = UNSET
    forward: Share = 0.0
    turn: Share = 0.0
    request: Literal["stop", "faster", "slower"] | UnsetType = UNSET


_DECODER = msgspec.json.Decoder(DriveSaid)


class DriveSessions(Sessions[DriveSaid]):
    """Serves the joystick page; `start` returns the command of cmr-teleop."""

    page, title, connects_to = "/drive", "drive by hand: joystick", "/drive/hands"
    most, full = MOST_DRIVERS, f"{MOST_DRIVERS} pages drive already."
    newest_only = True

    def __init__(self, start: Command, token: str, guesses: Guesses) -> None:
        super().__init__(HTML, token, guesses)
        self._start = start

    def said(self, data: Data) -> DriveSaid | None:
        """Return what a message says; None if no page says that."""
        return decoded(_DECODER, data)

    def command(self, message: DriveSaid) -> list[str] | None:
        """Return the command of cmr-teleop for the requested robot."""
        return self._start(message.robot, message.take_over) if isinstance(message.robot, int) else None

    def line(self, message: DriveSaid) -> bytes:
        """Return a message as a line for cmr-teleop."""
        known = {"beat": message.beat, "forward": message.forward, "turn": message.turn, "request": message.request}
        if message.beat is UNSET and message.request is UNSET:
            return b""
        return msgspec.json.encode({name: value for name, value in known.items() if value is not UNSET}) + b"\n"
