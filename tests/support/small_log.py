"""A log of a second with every type of message, as events: NaN, infinity, empty arrays and texts included."""

import math
from typing import Any

from cmr.bus.messages import make
from cmr.bus.streams import STREAMS
from cmr.msg import gyro_t, process_status_t
from cmr.recordings.events import Event

START = 1_700_000_000_000_000  # us
FIELDS: dict[str, dict[str, Any]] = {
    "MOTOR_COMMAND": {"left": 0.25, "right": -1.0},
    "WHEEL_SPEED_COMMAND": {"psi_left": 3.5, "psi_right": -math.nan},
    "VELOCITY_COMMAND": {"v": 0.4, "omega": -1.25},
    "MOTOR_FEEDBACK": {
        **{"ticks_left": 2**40, "ticks_right": -7, "psi_left": 0.1, "psi_right": -math.inf, "status": 9},
        **{"applied_left": 0.5, "applied_right": 0.0, "current_left": math.nan, "current_right": math.nan},
        **{"battery_voltage": 12.1, "temperature": math.nan, "received_utime": START + 9, "applied_utime": START - 2},
    },
    "MOTOR_DUTY": {"sent_left": 0.25, "sent_right": -0.25},
    "GYRO": {"yaw_rate": -0.3, "valid": 1, "received_utime": START + 5},
    "POSE": {"x": 1.5, "y": 1e-300, "theta": math.pi},
    "ROBOT_STATE": {
        **{"origin": 2, "x": 1.0, "y": 2.0, "theta": 3.0, "psi_left": 4.0, "psi_right": 5.0},
        **{"domega_left": 6.0, "domega_right": 7.0},
    },
    "WORLD_STATE": {
        **{"robot_id": [3, 4], "origin": [0, 1], "x": [0.5, -0.5], "y": [1.0, 2.0], "theta": [0.0, 0.25]},
        **{"psi_left": [1.0, 1.0], "psi_right": [2.0, 2.0], "domega_left": [0.0, 0.0], "domega_right": [3.0, 4.0]},
    },
    "RANGE_SCAN": {"angle_first": -1.0, "angle_step": 0.5, "range_max": 8.0, "ranges": [0.5, math.inf, 0.1]},
    "CAMERA_IMAGE": {"camera": "ceiling", "width": 2, "height": 1, "jpeg": b"\xff\xd8\x00\n\xff\xd9"},
    "WAYPOINTS": {"x": [], "y": []},
    "PARAMETERS": {"sequence": 5, "sha256": "ab", "yaml": 'schema: 1\nname: "a, b"\n'},
    "CALIBRATION_STATUS": {
        **{"state": 1, "progress": 0.5, "k2_over_k3": math.nan, "k1": 0.05, "base_width": 0.2},
        **{"k2_over_k3_std": 1.0, "k1_std": 0.1, "base_width_std": 0.01, "path_rmse_before": 0.5},
        **{"path_rmse_after": math.nan, "message": "Größe, \u2603"},
    },
    "INVESTIGATION_STATUS": {
        **{"state": 1, "driven": 5.5, "longest": 60.0, "explanations": '{"gyro_bias": 0.75, "nothing more": 0.25}'},
        **{"named": "[]", "excluded": 12, "not_shown": 3, "movement": "rest", "first": "gyro_bias"},
        **{"second": "nothing more", "members": 1, "x": [0.0, 0.5], "y": [1.0, 1.5], "message": ""},
    },
    "PROCESS_STATUS": {
        **{"process": "cmr-sim", "host": "lab", "pid": 7, "state": 1, "parameters_sha256": ""},
        **{"loop_rate_hz": 99.5, "loop_overruns": 0.0, "message": ""},
    },
    "ESTOP": {"engaged": True, "source": "a person", "reason": "smoke"},
    "PROCESS_REQUEST": {
        **{"wanted": True, "once": False, "host": "robot-pi", "run": "line-1", "name": "driver 0", "role": "driver"},
        **{"command": '["cmr-driver"]', "after": "", "files": "{}"},
    },
    "COMMAND_CLAIM": {"action": 0, "claimant": "cmr-pilot on lab1 (process 7)"},
    "COMMAND_OWNER": {"sender": -5, "owner": "cmr-pilot on lab1 (process 7)", "since_utime": 0},
    "ESTOP_LATCH": {
        **{"engaged": True, "stored": True, "since_utime": START + 3, "source": "a person", "reason": "smoke"},
    },
}


def process_status(utime: int, **fields: Any) -> process_status_t:
    """Return a report with these fields; the others are those of a simulator that is well."""
    return make(process_status_t, utime=utime, **{**FIELDS["PROCESS_STATUS"], **fields})


def small_log() -> list[Event]:
    """One message of every stream, of robot 3 where it has one, 10 ms apart, then gyro readings every 10 ms."""
    events = []
    for number, stream in enumerate(STREAMS):
        utime = START + 10_000 * number
        robot = {"robot_id": 3} if stream.per_robot else {}
        message = make(stream.message_type, utime=utime - 100, **robot, **FIELDS[stream.name])
        channel = stream.channel(3 if stream.per_robot else None)
        events.append(Event(number, utime, channel, message.encode()))
    return events + gyro_readings(len(events), 84)


def gyro_readings(first: int, count: int, channel: str = "GYRO_4") -> list[Event]:
    """Readings of robot 4's gyro, 10 ms apart, the first as event number `first`."""
    return [
        Event(
            number,
            START + 10_000 * number,
            channel,
            make(
                gyro_t,
                utime=START + 10_000 * number - 200,
                robot_id=4,
                yaw_rate=0.01 * number,
                valid=1,
                received_utime=START + 10_000 * number - 100,
            ).encode(),
        )
        for number in range(first, first + count)
    ]
