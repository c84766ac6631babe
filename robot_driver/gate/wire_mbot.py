"""The MBot board's protocol for the last gate: two kinds of frames that the driver sends, and one that the board sends.

A frame is `FF FE length check topic payload check`: length and topic in 16 bits, low byte first; each check is 255
minus the sum of the bytes before it modulo 256, the first over the length, the second over topic and payload. Payloads
are packed little-endian structures. Source: mbot-project/mbot_firmware, comms/src/protocol.c.
"""

import struct
from enum import IntEnum

from robot_driver.gate.wire import Request, Stop

START = b"\xff\xfe"
HEADER_BYTES = 7  # start, length, check, topic
OVERHEAD_BYTES = HEADER_BYTES + 1
NOTHING = bytes(40)  # more than the rest of a frame of duties, and not the beginning of another
REPEATED = 3  # times that duties are sent to a silent board
DUTIES, MOMENT = struct.Struct("<q3f"), struct.Struct("<q")  # us; duties of the left and right motor and of none


class Topic(IntEnum):
    """Topic of a frame."""

    TIMESYNC = 201
    IMU = 220
    ENCODERS = 221
    ANALOG_IN = 223
    ODOMETRY = 210
    MOTOR_PWM_COMMAND = 230
    MOTOR_VELOCITY = 232
    MOTOR_PWM = 233
    VELOCITY = 234


def packed(topic: int, payload: bytes) -> bytes:
    """Return a frame."""
    length, body = struct.pack("<H", len(payload)), struct.pack("<H", topic) + payload
    return START + length + check_of(length) + body + check_of(body)


def check_of(data: bytes) -> bytes:
    """Return the sum that follows `data`."""
    return bytes((255 - sum(data) % 256,))


class MBotWire:
    """A board of the classic kind, whose watchdog is built in; its right motor turns backward."""

    units = 0
    streams = True

    def read(self, data: bytes) -> list[Request] | None:
        """Return a request for each frame; the data may begin with NOTHING."""
        rest, requests = data.removeprefix(NOTHING), []
        while rest:
            for topic, layout in ((Topic.MOTOR_PWM_COMMAND, DUTIES), (Topic.TIMESYNC, MOMENT)):
                end = OVERHEAD_BYTES + layout.size
                payload = rest[HEADER_BYTES : end - 1]
                if len(payload) == layout.size and rest[:end] == packed(topic, payload):
                    break
            else:
                return None
            if topic is Topic.MOTOR_PWM_COMMAND:
                _, left, right, other = DUTIES.unpack(payload)
                if other != 0.0:
                    return None
                requests.append(Request((left, -right)))
            rest = rest[end:]
        return requests

    def stops(self, now: int) -> list[Stop]:
        """Send zero as to a silent board, and finally the time: with it, a silent board resumes with zero."""
        utime = now // 1000
        zero = packed(Topic.MOTOR_PWM_COMMAND, DUTIES.pack(utime, 0.0, 0.0, 0.0))
        return [Stop(NOTHING + REPEATED * zero + packed(Topic.TIMESYNC, MOMENT.pack(utime)), _reports_zero)]


def _reports_zero(reply: bytes) -> bool:
    """Return whether the last two frames on the duties in force say zero; the first of them may be older."""
    length = struct.pack("<H", DUTIES.size)
    begin = START + length + check_of(length) + struct.pack("<H", Topic.MOTOR_PWM)
    frames = [begin + piece[: DUTIES.size + 1] for piece in reply.split(begin)[1:]]
    said = [frame[HEADER_BYTES:-1] for frame in frames if frame == packed(Topic.MOTOR_PWM, frame[HEADER_BYTES:-1])]
    return len(said) > 1 and all(DUTIES.unpack(payload)[1:3] == (0.0, 0.0) for payload in said[-2:])
