"""Decode the bytes of a terminal to events: keys, its answers, and whether its window has the focus.

Sources: ECMA-48 for control sequences; "Comprehensive keyboard handling in terminals" of the terminal kitty for keys
that report their release (https://sw.kovidgoyal.net/kitty/keyboard-protocol/).
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass

PRESS, REPEAT, RELEASE, TYPED = "press", "repeat", "release", "typed"  # TYPED: pressed or repeated, not known which
ANSWER, FLAGS, LOST_FOCUS = "answer", "flags", "lost focus"
ESCAPE, SPACE, INTERRUPT = "escape", " ", "interrupt"

ASK = b"\x1b[5n"  # device status report: every terminal answers it
ASK_FLAGS = b"\x1b[?u"
REPORTING = 0b1011  # escape codes for all keys, with presses, repeats and releases
BEGIN = b"\x1b[>%du" % REPORTING
END = b"\x1b[<u"
RELEASES = 0b1010  # of the flags: without these, releases of letters are not reported
SEQUENCE = re.compile(rb"\x1b\[([<=>?]?)([0-9;:]*)([@-~])|\x1bO([@-~])")
UNFINISHED = re.compile(rb"\x1b(\[[<=>?]?[0-9;:]*|O)?$")
LONGEST = 64  # bytes of a sequence; longer ones are invalid
ARROWS = {b"A": "up", b"B": "down", b"C": "right", b"D": "left"}
EVENTS = {"1": PRESS, "2": REPEAT, "3": RELEASE}
CONTROL = 0b100  # of the modifiers
ENDINGS = "cd"  # with Ctrl


@dataclass(frozen=True)
class Event:
    """An event of a terminal: `kind`, and the key or number that belongs to it."""

    kind: str
    key: str = ""
    number: int = 0


class Decoder:
    """Converts bytes to events; a lone ESC becomes the key if nothing follows it (`flush`)."""

    def __init__(self) -> None:
        self._rest = b""
        self._pasting = False

    @property
    def waits(self) -> bool:
        """Whether the bytes so far may be the beginning of a sequence."""
        return bool(self._rest)

    def feed(self, data: bytes) -> Iterator[Event]:
        """Yield the events of these bytes, which follow those before."""
        data, self._rest = self._rest + data, b""
        while data:
            found = SEQUENCE.match(data)
            if found:
                data = data[found.end() :]
                yield from self._sequence(found)
            elif UNFINISHED.match(data) and len(data) <= LONGEST:
                self._rest = data
                return
            else:
                letter, data = data[:1], data[1:]
                yield from self._letter(letter)

    def flush(self) -> Iterator[Event]:
        """Yield the events of bytes that were waiting for a continuation."""
        rest, self._rest = self._rest, b""
        if rest == b"\x1b" and not self._pasting:
            yield Event(TYPED, ESCAPE)

    def _letter(self, letter: bytes) -> Iterator[Event]:
        if self._pasting:  # pasted letters must not drive the robot
            return
        if letter in (b"\x03", b"\x04"):
            yield Event(TYPED, INTERRUPT)
        elif letter == b"\x1b":
            yield Event(TYPED, ESCAPE)
        elif letter.isascii():
            yield Event(TYPED, letter.decode().lower())

    def _sequence(self, found: "re.Match[bytes]") -> Iterator[Event]:
        prefix, numbers, final, short = found.groups()
        fields = (numbers or b"").decode().split(";")
        if short is not None:
            final, prefix = short, b""
        if final == b"~" and fields[0] in ("200", "201"):
            self._pasting = fields[0] == "200"
        elif prefix == b"" and final == b"n" and fields == ["0"]:
            yield Event(ANSWER)
        elif prefix == b"?" and final == b"u":
            yield Event(FLAGS, number=int(fields[0] or 0))
        elif prefix == b"" and short is None and final == b"O":
            yield Event(LOST_FOCUS)
        elif prefix == b"" and final in ARROWS:
            yield Event(_kind(fields, TYPED), ARROWS[final])
        elif prefix == b"" and final == b"u":
            yield from _key(fields)


def _kind(fields: list[str], without: str) -> str:
    """Return the kind of a key's event, the field after its modifiers; `without` is the default."""
    modifiers, _, event = fields[1].partition(":") if len(fields) > 1 else ("", "", "")
    return EVENTS.get(event, without) if event else (PRESS if modifiers and without != TYPED else without)


def _key(fields: list[str]) -> Iterator[Event]:
    code = fields[0].partition(":")[0]
    if not code.isdecimal() or not 0 < int(code) < 0x110000:
        return
    letter = chr(int(code)).lower()
    modifiers = fields[1].partition(":")[0] if len(fields) > 1 else ""
    control = modifiers.isdecimal() and (int(modifiers) - 1) & CONTROL
    names = {"\x1b": ESCAPE} if not control else dict.fromkeys(ENDINGS, INTERRUPT)
    if not control or letter in names:
        yield Event(_kind(fields, PRESS), names.get(letter, letter))
