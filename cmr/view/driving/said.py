"""What the page with the joystick says: everything else is refused before anything is made of it."""

from typing import Annotated, Literal

import msgspec
from msgspec import UNSET, Meta, UnsetType
from websockets.typing import Data

MOST_BYTES = 600  # of a message

Share = Annotated[float, Meta(ge=-1.0, le=1.0)]


class Said(msgspec.Struct, forbid_unknown_fields=True, frozen=True, omit_defaults=True):
    """One message. First come tokens, then which robot is to be driven, then where the joystick is at each beat."""

    token: Annotated[str, Meta(max_length=256)] | UnsetType = UNSET
    robot: Annotated[int, Meta(ge=0, le=2**31 - 1)] | UnsetType = UNSET
    take_over: bool = False
    beat: Annotated[int, Meta(ge=0, le=2**53)] | UnsetType = UNSET
    forward: Share = 0.0
    turn: Share = 0.0
    wish: Literal["stop", "faster", "slower"] | UnsetType = UNSET


_DECODER = msgspec.json.Decoder(Said)


def said(data: Data) -> Said | None:
    """Return what a message says; None if no page says that."""
    if not isinstance(data, str) or len(data) > MOST_BYTES:
        return None
    try:
        return _DECODER.decode(data)
    except (msgspec.MsgspecError, ValueError, RecursionError):
        return None


def line(message: Said) -> bytes:
    """Return a message as a line for cmr-teleop."""
    known = {"beat": message.beat, "forward": message.forward, "turn": message.turn, "wish": message.wish}
    return msgspec.json.encode({name: value for name, value in known.items() if value is not UNSET}) + b"\n"
