"""Recordings of other robots and mappings of them, made here; and what cmr-import makes of them."""

import re
from pathlib import Path
from typing import Any

import lcm
import yaml

from cmr.bus.messages import decode
from cmr_tools.importing.import_log import main

NOMINAL = {"wheel_radius": 0.05, "base_width": 0.2}
START = 1_769_860_800_000_000  # us; 2026-01-31T12:00:00Z
CSV_HEAD: dict[str, Any] = {
    "about": "made in a test",
    "format": "csv",
    "time": {"column": "t", "start": "2026-01-31T12:00:00Z"},
    "nominal": NOMINAL,
}
POSE: dict[str, Any] = {
    "x": {"column": "x", "unit": "cm"},
    "y": {"column": "y", "unit": "m", "sign": -1},
    "theta": {"column": "theta", "unit": "deg", "scale": 2.0, "offset": 10.0},
}


def write_mapping(folder: Path, content: dict[str, Any]) -> str:
    path = folder / "robot.yaml"
    # The start must be a YAML time stamp, which is a text without quotes.
    path.write_text(re.sub(r"'(\d{4}-\d\d-\d\dT[\d:]+Z)'", r"\1", yaml.safe_dump(content)))
    return str(path)


def run(folder: Path, mapping: dict[str, Any], recording: Path, *options: str) -> dict[str, list[Any]]:
    """Import and return the log's messages by channel, in the order of the log."""
    out = folder / "run.lcm"
    assert main([write_mapping(folder, mapping), str(recording), "--out", str(out), *options]) == 0
    return messages_of(out)


def messages_of(log: Path) -> dict[str, list[Any]]:
    """Return a log's messages by channel, which are stamped by utime and in its order."""
    messages: dict[str, list[Any]] = {}
    last = 0
    for event in lcm.EventLog(str(log), "r"):
        message = decode(event.channel, event.data).message
        assert event.timestamp == message.utime >= last, "events are stamped by utime and in its order"
        last = event.timestamp
        messages.setdefault(event.channel, []).append(message)
    return messages


def write_csv(folder: Path, text: str, name: str = "recording.csv") -> Path:
    path = folder / name
    path.write_text(text)
    return path
