"""Generate docs/reference/emulated_devices.md, the commands of the emulated controllers, from their tables."""

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

This page lists the commands that the controllers of `cmr-emulate` understand. It is generated from their tables
(`scripts/write_emulated_devices`), and a test compares the two. A controller ignores any other command, or refuses it
if its protocol can, like a real controller with other firmware. When `cmr-emulate` ends, it lists the commands that
were not understood. In the tests, independent clients drive and read these controllers: basicmicro, tcr-roboclaw,
roboclaw, PyRoboteq and roboteq.

A RoboClaw or Roboteq that is commanded by speeds controls them in a loop of its own. The manufacturers do not publish
the control law. The emulator uses PID control with feed-forward: the commanded share of the full speed. The gains are
in `speed_loop` of [the settings](../tutorials/emulated_robot.md), where you set those that your robot was tuned with.
"""
ROBOCLAW = """
## RoboClaw

Packet serial of firmware 4.2, with one unit or two (`roboclaw`, `roboclaw-pair`). Integers are big-endian. A write is
acknowledged with FF, and needs a CRC; an answer has a CRC. A packet is dropped if two of its bytes arrive more than
10 ms apart. Speeds are in counts per second. An acceleration of 0 means no acceleration; the manual leaves this open.
Commands with distances or positions are not emulated.
"""
ROBOTEQ = """
## Roboteq

Text lines of an SDC2160 with two channels (`roboteq`). Names may be in lower case, numbers in square brackets, and a
plus sign at the end, as clients for real controllers write them. In closed loop, a command is a speed.
"""
MBOT = """
## MBot control board

Topics of the firmware for the classic robot (`mbot`). Integers are little-endian, and the right wheel is mirrored.
Velocities are driven in open loop, with the calibration stored on the board; duties are limited to 0.995.
"""
STORED_ONLY = "Settings without a star are only stored and read back: voltages, currents and pins have no effect."


def document() -> str:
    """Return the text of the page."""
    return "".join(
        (
            *(INTRODUCTION, ROBOCLAW, _commands("Driving", DRIVING), _commands("Sensing and timeout", SENSING)),
            _commands("Settings", SETTINGS, STORED_ONLY),
            *(ROBOTEQ, _lines("Actions", "!", ACTIONS), _lines("Queries", "?", QUERIES)),
            _lines("Settings of the Roboteq", "^", CONFIGURATION),
            *(MBOT, _topics("Received", TAKEN), _topics("Sent, while the board receives the time", SAID)),
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
    head = f"\n### {title}\n{f'{chr(10)}{remark}{chr(10)}' if remark else ''}\n"
    return head + _table(("command", "data", "answer", "meaning"), rows)


def _lines(title: str, sign: str, entries: Mapping[str, tuple[object, ...]]) -> str:
    rows = ((f"`{sign}{name}`", str(entry[0])) for name, entry in entries.items())
    return f"\n### {title}\n\n" + _table(("line", "meaning"), rows)


def _topics(title: str, topics: Mapping[int, Topic]) -> str:
    rows = (
        (str(number), f"`{topic.name}`", _layout(topic.layout), topic.what) for number, topic in sorted(topics.items())
    )
    return f"\n### {title}\n\n" + _table(("topic", "name", "payload", "meaning"), rows)


def _table(head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    lines = [head, ("---",) * len(head), *rows]
    return "".join(f"| {' | '.join(cells)} |\n" for cells in lines).replace("|  |", "| |")


def _layout(layout: str | None) -> str:
    """Return a layout of `struct` as a list of types."""
    if layout is None:
        return "differs"
    parts = re.findall(r"([0-9]*)([a-zA-Z])", layout)
    return ", ".join(KINDS[kind] for count, kind in parts for _ in range(int(count or 1)))
