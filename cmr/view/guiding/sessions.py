"""Sessions of the bring-up page: its answers go to a process of cmr bringup, whose steps come back.

The process itself stops a motion if the page does not answer (`robot_driver.guided.remote`).
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated

import msgspec
from msgspec import UNSET, Meta, UnsetType
from websockets.typing import Data

from cmr.view.beside.sessions import Entering, Sessions, decoded
from cmr.view.entrance.guesses import Guesses

HTML = Path(__file__).with_name("bringup.html")

Word = Annotated[str, Meta(pattern="^[a-z]{1,20}$")]
Command = Callable[[int, Sequence[str]], list[str]]  # of cmr bringup, for a robot and steps


class GuideSaid(Entering, forbid_unknown_fields=True, frozen=True, omit_defaults=True):
    """One message: first tokens, then robot and steps, then beats and answers to the step shown."""

    robot: Annotated[int, Meta(ge=0, le=2**31 - 1)] | UnsetType = UNSET
    steps: Annotated[tuple[Word, ...], Meta(max_length=20)] = ()
    beat: Annotated[int, Meta(ge=0, le=2**53)] | UnsetType = UNSET
    step: Annotated[int, Meta(ge=0, le=2**53)] | UnsetType = UNSET
    answer: Annotated[str, Meta(max_length=100)] = ""


_DECODER = msgspec.json.Decoder(GuideSaid)


class GuideSessions(Sessions[GuideSaid]):
    """Serves the page; `start` returns the command of cmr bringup. Only one robot at a time."""

    page, title, connects_to = "/bringup", "bring up a new robot", "/bringup/steps"
    most, full = 1, "A robot is being brought up on another page already."

    def __init__(self, start: Command, token: str, guesses: Guesses) -> None:
        super().__init__(HTML, token, guesses)
        self._start = start

    def said(self, data: Data) -> GuideSaid | None:
        """Return what a message says; None if no page says that."""
        return decoded(_DECODER, data)

    def command(self, message: GuideSaid) -> list[str] | None:
        """Return the command of cmr bringup for a robot."""
        return self._start(message.robot, message.steps) if isinstance(message.robot, int) else None

    def line(self, message: GuideSaid) -> bytes:
        """Return a message as a line for cmr bringup."""
        if isinstance(message.step, int):
            return msgspec.json.encode({"step": message.step, "answer": message.answer}) + b"\n"
        return msgspec.json.encode({"beat": message.beat}) + b"\n" if isinstance(message.beat, int) else b""
