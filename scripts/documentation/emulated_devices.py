"""The page docs/reference/emulated_devices.md on the emulated controllers' commands, generated from their tables."""

import re
from collections.abc import Iterable, Mapping

from documentation.imports import PROJECT
from robot_driver.emulator.boards.mbot_topics import SAID, TAKEN, Topic
from robot_driver.emulator.boards.roboclaw_commands import DRIVING, SENSING, SETTINGS, Read, Write
from robot_driver.emulator.boards.roboteq_commands import ACTIONS, QUERIES
from robot_driver.emulator.boards.roboteq_commands import SETTINGS as CONFIGURATION

PAGE = PROJECT / "docs" / "reference" / "emulated_devices.md"
KINDS = {"B": "u8", "H": "u16", "I": "u32", "h": "i16", "i": "i32", "q": "i64", "f": "f32"}
WITH_EFFECT = {28, 29, 55, 56, 68, 69, 80, 81, 94, 95}  # settings with an effect
INTRODUCTION = """\
# Emulated motor controllers

What the controllers of `cmr-emulate` understand. The page comes from their tables (`scripts/write_emulated_devices`),
and a test compares the two. A controller does not answer what is in no table, or refuses it where its protocol can, as
a real one of another firmware; at its end `cmr-emulate` names what was not understood. Clients that nobody here wrote
drive and read these controllers in the tests: basicmicro, tcr-roboclaw, roboclaw, PyRoboteq and roboteq.

A RoboClaw and a Roboteq that are given speeds keep them by a loop of their own. Makers do not print its law: here it is
PID with the wanted share of the full speed added. Its gains are in `speed_loop` of
[the settings](../tutorials/emulated_robot.md), as who set the robot up has tuned them.
"""
ROBOCLAW = """
## RoboClaw

Packet serial of firmware 4.2, one unit or two (`roboclaw`, `roboclaw-pair`). Integers are big-endian. A write is
acknowledged with FF, and needs a CRC; an answer has one. A packet of which two bytes come more than 10 ms apart is
dropped. Speeds are in counts a second. An acceleration of 0 is none, which the manual leaves open. Commands with
distances and positions are not emulated.
"""
ROBOTEQ = """
## Roboteq

Lines of an SDC2160 with two channels (`roboteq`). Names may be in small letters, numbers in square brackets, and a plus
sign at the end: clients that are used with real ones write so. In closed loop, a command is followed as a speed.
"""
MBOT = """
## MBot control board

Topics of the firmware for the classic robot (`mbot`). Integers are little-endian, the right wheel is mirrored.
Velocities are driven in open loop by the calibration that the board keeps; duties beyond 0.995 give no more.
"""
KEPT_ONLY = " Those below without a star are only kept and read back: no voltage, current or pin has an effect."


def document() -> str:
    """Return the text of the page."""
    return "".join(
        (
            *(INTRODUCTION, ROBOCLAW, _commands("Driving", DRIVING), _commands("Sensing and timeout", SENSING)),
            _commands("Settings", SETTINGS, KEPT_ONLY),
            *(ROBOTEQ, _lines("Actions", "!", ACTIONS), _lines("Queries", "?", QUERIES)),
            _lines("Settings of the Roboteq", "^", CONFIGURATION),
            *(MBOT, _topics("Taken", TAKEN), _topics("Said, while it is sent the time", SAID)),
        )
    )


def _commands(title: str, commands: Mapping[int, Read | Write], remark: str = "") -> str:
    rows = (
        (
            f"{number}{'*' if number in WITH_EFFECT else ''}",
            _layout(entry.layout) if isinstance(entry, Write) else "",
            "FF" if isinstance(entry, Write) else _layout(entry.layout),
            entry.what,
        )
        for number, entry in sorted(commands.items())
    )
    head = f"\n### {title}\n{f'{chr(10)}{remark.strip()}{chr(10)}' if remark else ''}\n"
    return head + _table(("command", "data", "answer", "what it is"), rows)


def _lines(title: str, sign: str, entries: Mapping[str, tuple[object, ...]]) -> str:
    rows = ((f"`{sign}{name}`", str(entry[0])) for name, entry in entries.items())
    return f"\n### {title}\n\n" + _table(("line", "what it is"), rows)


def _topics(title: str, topics: Mapping[int, Topic]) -> str:
    rows = ((str(number), f"`{one.name}`", _layout(one.layout), one.what) for number, one in sorted(topics.items()))
    return f"\n### {title}\n\n" + _table(("topic", "name", "payload", "what it is"), rows)


def _table(head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    lines = [head, ("---",) * len(head), *rows]
    return "".join(f"| {' | '.join(cells)} |\n" for cells in lines).replace("|  |", "| |")


def _layout(layout: str | None) -> str:
    """Return a layout of `struct` in words."""
    if layout is None:
        return "differs"
    parts = re.findall(r"([0-9]*)([a-zA-Z])", layout)
    return ", ".join(KINDS[kind] for count, kind in parts for _ in range(int(count or 1)))
