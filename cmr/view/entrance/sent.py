"""Valid messages of viser's protocol from a visitor's page: others are refused before viser reads them.

Viser trusts its input: a camera with zero height, NaN positions, or inputs of wrong types raise exceptions deep inside.
"""

import math
from typing import Annotated, Any

import msgspec
from msgspec import Meta
from websockets.typing import Data

MOST_BYTES = 1_000_000  # of a message; viser's page sends files in parts of 512 KB
FARTHEST = 1e6  # m from the origin, for cameras and pixels

Coordinate = Annotated[float, Meta(ge=-FARTHEST, le=FARTHEST)]
Positive = Annotated[float, Meta(gt=0.0, le=1e9)]
Angle = Annotated[float, Meta(ge=0.01, le=3.1)]
Pixels = Annotated[int, Meta(ge=1, le=100_000)]
Count = Annotated[int, Meta(ge=0, le=1 << 53)]  # largest exact integer of a browser
Short = Annotated[str, Meta(max_length=256)]
Vector = tuple[Coordinate, Coordinate, Coordinate]


class _Sent(msgspec.Struct, tag_field="type", forbid_unknown_fields=True, frozen=True):
    def is_valid(self) -> bool:
        """Return whether the fields are consistent."""
        return True


class _Camera(_Sent, tag="ViewerCameraMessage", frozen=True):
    wxyz: tuple[Coordinate, Coordinate, Coordinate, Coordinate]
    position: Vector
    fov: Angle
    near: Positive
    far: Positive
    image_height: Pixels
    image_width: Pixels
    look_at: Vector
    up_direction: Vector

    def is_valid(self) -> bool:
        """Return whether position, direction and up vector are valid."""
        looks = math.dist(self.look_at, self.position) > 1e-6
        return looks and math.hypot(*self.up_direction) > 1e-6 and math.hypot(*self.wxyz) > 1e-6


class _Click(_Sent, tag="SceneNodeClickMessage", frozen=True):
    name: Short
    instance_index: Count | None
    ray_origin: Vector
    ray_direction: Vector
    screen_pos: tuple[Coordinate, Coordinate]
    modifier: Short | None
    owner: Short = ""


class _Update(_Sent, tag="GuiUpdateMessage", frozen=True):
    uuid: Short
    updates: Annotated[dict[Short, Any], Meta(min_length=1, max_length=1)]

    def is_valid(self) -> bool:
        """Return whether it can be an input's value; whether the input accepts it is checked there."""
        value = self.updates.get("value", [])
        return isinstance(value, str | bool | int | float) and (not isinstance(value, float) or math.isfinite(value))


class _Command(_Sent, tag="CommandTriggerMessage", frozen=True):
    uuid: Short


class _UploadStart(_Sent, tag="FileTransferStartUpload", frozen=True):
    source_component_uuid: Short
    transfer_uuid: Short
    filename: Annotated[str, Meta(max_length=1024)]
    mime_type: Short
    part_count: Count
    size_bytes: Count


class _UploadPart(_Sent, tag="FileTransferPart", frozen=True):
    source_component_uuid: Short | None
    transfer_uuid: Short
    part_index: Count
    content: bytes


_DECODER = msgspec.msgpack.Decoder(_Camera | _Click | _Update | _Command | _UploadStart | _UploadPart)


def is_from_a_page(data: Data) -> bool:
    """Return whether this is a valid message of a visitor's page."""
    if not isinstance(data, bytes):
        return False
    try:
        message: _Sent = _DECODER.decode(data)
    except (msgspec.MsgspecError, RecursionError, ValueError):
        return False
    return message.is_valid()
