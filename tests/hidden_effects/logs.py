"""Write a recording as the event log that a logger on the bus would have made."""

import math
from pathlib import Path
from typing import Any

import lcm

from cmr.msg import (
    gyro_t,
    motor_command_t,
    motor_feedback_t,
    pose_xyt_t,
    velocity_command_t,
    wheel_speed_command_t,
)
from cmr.recordings.recording import Recording

Event = tuple[int, str, bytes]  # utime, channel, encoded message
MEASURED = ("ticks_left", "ticks_right", "psi_left", "psi_right", "applied_left", "applied_right")


def write_log(path: Path, recording: Recording) -> Path:
    """Write the messages of a recording, whose parameters are announced first, in the order of their times."""
    assert recording.parameters is not None
    start = min(int(signal.utime[0]) for signal in recording.signals.values() if len(signal))
    announcement = recording.parameters.announcement(sequence=start)
    announcement.utime = start
    events: list[Event] = [(start, f"PARAMETERS_{recording.robot_id}", announcement.encode())]
    events += _events(recording, "commands", "MOTOR_COMMAND", motor_command_t, {})
    events += _events(recording, "wheel_speed_commands", "WHEEL_SPEED_COMMAND", wheel_speed_command_t, {})
    events += _events(recording, "velocity_commands", "VELOCITY_COMMAND", velocity_command_t, {})
    events += _events(recording, "wheels", "MOTOR_FEEDBACK", motor_feedback_t, _not_measured())
    events += _events(recording, "gyro", "GYRO", gyro_t, {"valid": 1})
    events += _events(recording, "poses", "POSE", pose_xyt_t, {})
    log = lcm.EventLog(str(path), "w", overwrite=True)
    for utime, channel, data in sorted(events, key=lambda event: event[0]):
        log.write_event(utime, channel, data)
    log.close()
    return path


def _events(recording: Recording, name: str, stream: str, message_type: Any, constant: dict[str, Any]) -> list[Event]:
    """Return the messages of one signal; `constant` fields are the same in each."""
    signal, channel = getattr(recording, name), f"{stream}_{recording.robot_id}"
    columns = {field: _as_sent(field, values.tolist()) for field, values in signal.fields.items()}
    message, events = message_type(), []
    for field, value in {"robot_id": recording.robot_id, **constant}.items():
        setattr(message, field, value)
    stamped = [field for field in ("utime", "received_utime") if field in message.__slots__]
    for utime, *values in zip(signal.utime.tolist(), *columns.values(), strict=True):
        for field in stamped:
            setattr(message, field, utime)
        for field, value in zip(columns, values, strict=True):
            setattr(message, field, value)
        events.append((utime, channel, message.encode()))
    return events


def _as_sent(field: str, values: list[float]) -> list[Any]:
    return [round(value) for value in values] if field.startswith("ticks") else values


def _not_measured() -> dict[str, Any]:
    """Return what a simple motor controller does not tell."""
    unknown = ("current_left", "current_right", "battery_voltage", "temperature")
    return {**dict.fromkeys(unknown, math.nan), "status": 0}
