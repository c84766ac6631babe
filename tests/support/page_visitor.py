"""Who connects to the page of cmr-view without its browser, and what such a stranger may send."""

import json
import random
from collections.abc import Iterable
from typing import Any

import msgspec.msgpack
import viser
import zstandard
from viser import _messages

PROTOCOL = f"viser-v{viser.__version__}"
CAMERA: dict[str, Any] = {
    "type": "ViewerCameraMessage",
    "wxyz": [1.0, 0.0, 0.0, 0.0],
    "position": [0.0, -0.01, 6.0],
    "fov": 0.75,
    "near": 0.01,
    "far": 1000.0,
    "image_height": 600,
    "image_width": 800,
    "look_at": [0.0, 0.0, 0.0],
    "up_direction": [0.0, 0.0, 1.0],
}
CLICK: dict[str, Any] = {
    "type": "SceneNodeClickMessage",
    "name": "/robots",
    "instance_index": 0,
    "ray_origin": [0.0, 0.0, 6.0],
    "ray_direction": [0.0, 0.0, -1.0],
    "screen_pos": [0.5, 0.5],
    "modifier": None,
    "owner": "",
}
ODD: list[Any] = [
    *(0, -1, 1, 2, 10**6, 2**31 - 1, 2**63 - 1, -(2**63)),
    *(0.0, -0.0, 0.5, 1e-300, 1e300, float("nan"), float("inf"), float("-inf")),
    *(
        "",
        "0",
        "1:30",
        "x" * 300,
        "\x1b[2J",
        "\udcff".encode(errors="replace").decode(),
        "from above",
        "follow the robot",
    ),
    *(None, True, False, b"", bytes(600), [], {}, [[[]]], {"value": 1}, ["a"], [0.0] * 3, [0.0] * 4, [1e300] * 3),
]
NAMES = sorted(kind.__name__ for kind in _messages.Message.get_subclasses())


def packed(message: object) -> bytes:
    """Return a message as a browser sends it."""
    return msgspec.msgpack.encode(message)


def camera(**changed: Any) -> bytes:
    """Return where a browser has its camera."""
    return packed(CAMERA | changed)


def told(packet: bytes) -> list[dict[str, Any]]:
    """Return the messages that the server sends together."""
    size = int.from_bytes(packet[8:16], "little")
    decoded: dict[str, Any] = msgspec.msgpack.decode(zstandard.ZstdDecompressor().decompress(packet[16 : 16 + size]))
    return list(decoded["messages"])


def names_of_parts(messages: Iterable[dict[str, Any]]) -> list[str]:
    """Return the identifiers of inputs and commands that a page is made of."""
    return [message["uuid"] for message in messages if "uuid" in message and "updates" not in message]


class Stranger:
    """Makes messages that are nearly those of a page, or nothing like it; the same ones for the same seed."""

    def __init__(self, seed: int) -> None:
        self.parts: list[str] = []  # identifiers that the page is known to have
        self._random = random.Random(seed)

    def message(self) -> bytes | str:
        """Return something to send."""
        chance = self._random.random()
        if chance < 0.05:
            return self._random.randbytes(self._random.randrange(200))
        if chance < 0.07:
            return json.dumps(self._template(), default=str)
        message = self._template()
        for _ in range(self._random.choice((0, 1, 1, 1, 2, 5))):
            self._change(message)
        data = packed(message)
        return data[: self._random.randrange(len(data))] if chance > 0.97 else data

    def _template(self) -> dict[str, Any]:
        part = self._random.choice(self.parts) if self.parts else "nobody"
        size = self._random.randrange(2000)
        return self._random.choice(
            [
                dict(CAMERA),
                CLICK | {"instance_index": self._random.randrange(20)},
                {"type": "GuiUpdateMessage", "uuid": part, "updates": {"value": self._random.choice(ODD)}},
                {"type": "GuiUpdateMessage", "uuid": part, "updates": {"value": self._random.uniform(0.0, 2.0)}},
                {"type": "CommandTriggerMessage", "uuid": part},
                self._part_of_file(part, size),
                {
                    **{"type": "FileTransferStartUpload", "source_component_uuid": part, "transfer_uuid": "t"},
                    **{"filename": "run.lcm", "mime_type": "", "part_count": size // 500, "size_bytes": size},
                },
                {"type": self._random.choice(NAMES), "uuid": part, "name": "/robots"},
            ]
        )

    def _part_of_file(self, part: str, size: int) -> dict[str, Any]:
        index = self._random.randrange(4)
        content = bytes(size)
        return {
            **{"type": "FileTransferPart", "source_component_uuid": part, "transfer_uuid": "t"},
            **{"part_index": index, "content": content},
        }

    def _change(self, message: dict[str, Any]) -> None:
        """Give one field, or one of its elements, an odd value; or take a field away, or add one."""
        name = self._random.choice(list(message))
        value, odd = message[name], self._random.choice(ODD)
        chance = self._random.random()
        if chance < 0.05 and len(message) > 1:
            del message[name]
        elif chance < 0.1:
            message[self._random.choice(("owner", "x", "value", "__class__"))] = odd
        elif isinstance(value, list) and value and chance < 0.5:
            message[name] = [odd if self._random.random() < 0.4 else element for element in value]
        elif isinstance(value, dict) and chance < 0.7:
            message[name] = {self._random.choice(("value", "visible", "_impl", "removed")): odd}
        elif name != "type" or chance < 0.3:
            message[name] = odd
