"""The table of channels: name, message type, rate and owner of every stream on the bus."""

import re
from dataclasses import dataclass
from functools import lru_cache
from typing import Generic

from cmr import msg
from cmr.bus.message import M_co, Message
from cmr.cli.configuration import LARGEST_ROBOT_ID

LCM_CHANNEL_NAME_LIMIT = 63  # bytes; LCM refuses longer names
COMMAND_LIFETIME = 500_000  # us; an older command of any kind means zero, for real and simulated robots alike
SELF_TEST = "CMR_SELF_TEST"  # channel on which our processes test the bus when they start
SELF_TESTS = (SELF_TEST, "LCM_SELF_TEST")  # ours and LCM's own; messages on them are for nobody else


@dataclass(frozen=True)
class Stream(Generic[M_co]):
    """One kind of channel.

    `name` is the whole channel name, or its beginning where each robot has a channel of its own (MOTOR_COMMAND_7 for
    robot 7). `rate_hz` is the lowest rate at which its owner publishes while it runs; None means irregularly.
    """

    name: str
    message_type: type[M_co]
    per_robot: bool
    rate_hz: float | None
    owner: str

    def channel(self, robot_id: int | None = None) -> str:
        """Return the channel name; `robot_id` is required if and only if each robot has a channel of its own.

        Raises ValueError when `robot_id` is missing, superfluous, negative or too large for a message.
        """
        if not self.per_robot:
            if robot_id is not None:
                raise ValueError(f"{self.name} is one channel for all robots; it takes no robot id")
            return self.name
        if robot_id is None or not 0 <= robot_id <= LARGEST_ROBOT_ID:
            raise ValueError(f"{self.name} needs a robot id of 0 to {LARGEST_ROBOT_ID}, not {robot_id}")
        return f"{self.name}_{robot_id}"

    @property
    def pattern(self) -> str:
        """Regular expression that LCM matches against whole channel names: this stream of every robot."""
        return f"{self.name}_[0-9]+" if self.per_robot else self.name


MOTOR_COMMAND = Stream("MOTOR_COMMAND", msg.motor_command_t, True, 20.0, "cmr-pilot, or any controller")
WHEEL_SPEED_COMMAND = Stream(
    "WHEEL_SPEED_COMMAND", msg.wheel_speed_command_t, True, 20.0, "cmr-pilot, or any controller"
)
VELOCITY_COMMAND = Stream("VELOCITY_COMMAND", msg.velocity_command_t, True, 20.0, "cmr-pilot, or any controller")
COMMAND_CLAIM = Stream("COMMAND_CLAIM", msg.command_claim_t, True, None, "cmr-pilot, or any controller")
COMMAND_OWNER = Stream("COMMAND_OWNER", msg.command_owner_t, True, 2.0, "cmr-driver; cmr-sim of claimed virtual robots")
MOTOR_FEEDBACK = Stream("MOTOR_FEEDBACK", msg.motor_feedback_t, True, 50.0, "cmr-driver")
MOTOR_DUTY = Stream("MOTOR_DUTY", msg.motor_duty_t, True, None, "cmr-driver")
GYRO = Stream("GYRO", msg.gyro_t, True, 50.0, "cmr-driver")
POSE = Stream("POSE", msg.pose_xyt_t, True, 5.0, "external localisation")
ROBOT_STATE = Stream("ROBOT_STATE", msg.robot_state_t, True, 20.0, "cmr-sim")
WORLD_STATE = Stream("WORLD_STATE", msg.world_state_t, False, 20.0, "cmr-sim")
RANGE_SCAN = Stream("RANGE_SCAN", msg.range_scan_t, True, 10.0, "cmr-sim, for robots with a range sensor")
CAMERA_IMAGE = Stream("CAMERA_IMAGE", msg.camera_image_t, False, None, "cmr-camera")
WAYPOINTS = Stream("WAYPOINTS", msg.waypoints_t, True, None, "whoever plans")
PARAMETERS = Stream("PARAMETERS", msg.parameters_t, True, 1.0, "whoever wrote the file, and cmr-sim")
CALIBRATION_STATUS = Stream("CALIBRATION_STATUS", msg.calibration_status_t, True, 2.0, "cmr-calibrate")
INVESTIGATION_STATUS = Stream(
    "INVESTIGATION_STATUS", msg.investigation_status_t, True, 1.0, "cmr-investigate; cmr-pilot that investigates"
)
PROCESS_STATUS = Stream("PROCESS_STATUS", msg.process_status_t, False, 1.0, "every process")
PROCESS_REQUEST = Stream("PROCESS_REQUEST", msg.process_request_t, False, None, "cmr-run, to agents on other computers")
ESTOP = Stream("ESTOP", msg.estop_t, False, 10.0, "whoever engages it, while engaged")
ESTOP_LATCH = Stream("ESTOP_LATCH", msg.estop_latch_t, True, 1.0, "cmr-driver")

STREAMS: tuple[Stream[Message], ...] = (
    MOTOR_COMMAND,
    WHEEL_SPEED_COMMAND,
    VELOCITY_COMMAND,
    COMMAND_CLAIM,
    COMMAND_OWNER,
    MOTOR_FEEDBACK,
    MOTOR_DUTY,
    GYRO,
    POSE,
    ROBOT_STATE,
    WORLD_STATE,
    RANGE_SCAN,
    CAMERA_IMAGE,
    WAYPOINTS,
    PARAMETERS,
    CALIBRATION_STATUS,
    INVESTIGATION_STATUS,
    PROCESS_STATUS,
    PROCESS_REQUEST,
    ESTOP,
    ESTOP_LATCH,
)

_BY_NAME = {stream.name: stream for stream in STREAMS}
_ROBOT_CHANNEL = re.compile(r"([A-Z_]+)_(0|[1-9][0-9]{0,9})")
_MOST_REMEMBERED = 16_384  # cached channel names, which any sender can choose; enough for a thousand robots


@lru_cache(_MOST_REMEMBERED)  # called for every message, and parsing a name takes longer than most handlers
def identify(channel: str) -> tuple[Stream[Message], int | None] | None:
    """Return the stream and the robot id of a channel name; None for an unknown channel."""
    stream = _BY_NAME.get(channel)
    if stream is not None and not stream.per_robot:
        return stream, None
    match = _ROBOT_CHANNEL.fullmatch(channel)
    if match is None or int(match[2]) > LARGEST_ROBOT_ID:
        return None
    stream = _BY_NAME.get(match[1])
    return (stream, int(match[2])) if stream is not None and stream.per_robot else None
