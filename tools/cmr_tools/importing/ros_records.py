"""Contents of a bag, independent of its format: topics and messages, and what is damaged."""

import re
from abc import ABC, abstractmethod
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

from cmr.plain_text import plain
from cmr_tools.importing.unpacking import LARGEST_RECORD

COMPRESSIONS = ("", "none", "bz2", "lz4", "zstd")

LONGEST_CUT_CHUNK = 1 << 26  # bytes examined of a chunk that seems to extend beyond the end of the file
LONGEST_NAME = 256  # characters of a topic's or type's name, as in ROS

_WINDOW_BYTES = 1 << 20


class Topic(NamedTuple):
    """One topic as a bag announces it.

    `encoding` is that of its messages (ros1, cdr, json, ...); `definition` the text of their type, in `language`
    (msg, idl, jsonschema or empty, where the bag holds none).
    """

    name: str
    message_type: str
    encoding: str
    definition: str
    language: str


class Message(NamedTuple):
    """One message: when the recorder received it and, where the bag says so, when it was published [ns]."""

    topic: Topic
    received: int
    published: int | None
    data: bytes


class BagError(Exception):
    """The file is not a readable bag; the text says why."""


class BagReader(ABC):
    """Reads the messages of the `wanted` topics from one file, in the order of the file.

    Everything intact is read. After the iteration `topics` holds the types of all topics by name, wanted or not, and
    `sentence` describes the damage. `position` of `size` bytes have been read.
    """

    def __init__(self, path: Path, wanted: frozenset[str]) -> None:
        self.path = path
        self.size = path.stat().st_size
        self.position = 0
        self.topics: dict[str, set[str]] = {}
        self._wanted = wanted
        self._faults: dict[str, int] = {}
        self._damaged_bytes = 0
        self._damaged_places = 0
        self._is_intact = True  # the current record

    @abstractmethod
    def __iter__(self) -> Iterator[Message]:
        """Read the file from its beginning."""

    def sentence(self) -> str:
        """Return a sentence on the damage; empty if there was none."""
        faults = [name if count == 1 else f"{name} ({count} times)" for name, count in self._faults.items()]
        if self._damaged_bytes:
            places = "1 place" if self._damaged_places == 1 else f"{self._damaged_places} places"
            faults.insert(0, f"{self._damaged_bytes} bytes in {places} are no intact records")
        return f"{self.path.name} is truncated or damaged: {'; '.join(faults)}; the rest is used." if faults else ""

    def announce(self, topic: Topic) -> Topic:
        """Record a topic of the bag; return it with names that are safe to print."""
        shown = topic._replace(
            name=plain(topic.name, LONGEST_NAME),
            message_type=plain(topic.message_type, LONGEST_NAME),
            encoding=plain(topic.encoding, LONGEST_NAME),
        )
        self.topics.setdefault(shown.name, set()).add(shown.message_type)
        return shown

    def is_too_large(self, size: int) -> bool:
        """Return whether a record of this size, packed or unpacked, is too large to be read; if so, record that."""
        if size > LARGEST_RECORD:
            self.fault(f"a record of more than {LARGEST_RECORD / 1e6:.0f} MB, which is the most that is read at once")
        return size > LARGEST_RECORD

    def damage(self, count: int) -> None:
        """Record that this many bytes in one place are damaged."""
        if count > 0:
            self._damaged_bytes += count
            self._damaged_places += 1

    def fault(self, what: str) -> None:
        """Record another fault, in words."""
        self._faults[what] = self._faults.get(what, 0) + 1


def type_name(name: str) -> str:
    """Return a message type's name as ROS 2 writes it: nav_msgs/msg/Odometry."""
    package, _, last = name.partition("/")
    return f"{package}/msg/{last}" if last and "/" not in last else name


def places(stream: BinaryIO, start: int, pattern: re.Pattern[bytes], longest: int) -> Iterator[int]:
    """Yield where in the file, from `start` on, the pattern matches; a match is at most `longest` bytes."""
    while True:
        stream.seek(start)
        window = stream.read(_WINDOW_BYTES)
        is_last = len(window) < _WINDOW_BYTES
        step = len(window) if is_last else len(window) - longest
        for match in pattern.finditer(window):
            if match.start() < step:
                yield start + match.start()
        if is_last:
            return
        start += step
