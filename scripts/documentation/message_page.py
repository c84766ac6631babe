"""Generate the page of message types from lcmtypes/*.lcm and the table of streams, in MyST Markdown."""

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from cmr.bus.streams import STREAMS
from documentation.command_pages import escaped

MEMBER = re.compile(r"(const )?(\w+) (.*);")
STRUCT = re.compile(r"struct (\w+)")


@dataclass
class Message:
    """A message type: its name, its description, and its members as (name, type, meaning)."""

    name: str = ""
    about: str = ""
    fields: list[tuple[str, str, str]] = field(default_factory=list)
    constants: list[tuple[str, str, str]] = field(default_factory=list)


def read(text: str) -> Message:
    """Read an .lcm file with one struct. A comment describes the line or lines that follow it."""
    message, comment, fresh = Message(), "", True
    for line in map(str.strip, text.splitlines()):
        if line.startswith("//"):
            comment = line[2:].strip() if fresh else f"{comment} {line[2:].strip()}"
            fresh = False
            continue
        fresh = True
        if struct := STRUCT.match(line):
            message.name, message.about = struct[1], comment
        elif message.name and (member := MEMBER.fullmatch(line)):
            members = message.constants if member[1] else message.fields
            members.append((member[3], member[2], comment))
    return message


def page(files: Iterable[Path]) -> str:
    """Return the page of all message types."""
    lines = [
        "# Messages\n",
        "Every message type of the LCM bus, generated from `lcmtypes/*.lcm`. Units are in brackets.",
        "In a channel name, `N` stands for the robot's id.\n",
        *_channels(),
    ]
    for path in files:
        lines += _section(read(path.read_text("utf-8")))
    return "\n".join(lines)


def _channels() -> Iterator[str]:
    yield "| channel | message type |\n|---|---|"
    for stream in STREAMS:
        name = stream.message_type.__name__
        yield f"| `{stream.name}{'_N' if stream.per_robot else ''}` | [`{name}`](#{name}) |"
    yield ""


def _section(message: Message) -> Iterator[str]:
    yield f"({message.name})=\n## {escaped(message.name)}\n"
    yield f"{escaped(message.about)}\n"
    yield "| field | type | meaning |\n|---|---|---|"
    for names, kind, meaning in message.fields:
        yield f"| `{names}` | {kind} | {escaped(meaning)} |"
    yield ""
    if message.constants:
        yield "| constant | meaning |\n|---|---|"
        for names, _kind, meaning in message.constants:
            yield f"| `{names}` | {escaped(meaning)} |"
        yield ""
