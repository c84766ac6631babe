"""Flood a bus with valid and invalid messages of every type: python -m fuzzing.sender URL RATE SEED."""

import os
import sys
import time
from random import Random

from cmr.bus.messages import now_utime
from cmr.bus.preflight import key_of, open_lcm
from cmr.bus.signing import Signer
from cmr.bus.streams import COMMAND_CLAIM, COMMAND_OWNER, ESTOP, PARAMETERS, PROCESS_REQUEST, STREAMS
from cmr.msg import estop_t
from fuzzing.draws import Draws
from fuzzing.messages import TEXTS, fuzzed, message_of
from fuzzing.signatures import Signatures

ROBOTS = (0, 0, 0, 0, 0, 10, 11, 12)  # the real robot, virtual robots, and one that does not exist
LONGEST_DRAW = 150  # bytes
RARE = {
    ESTOP: 40,
    PARAMETERS: 5,
    COMMAND_CLAIM: 40,
    COMMAND_OWNER: 400,
    PROCESS_REQUEST: 5,
}  # sent this many times less often than others: these messages stop or take over the robot
RELEASE_EVERY_S = 5.0  # the emergency stop is released, or the robot would never drive again
LARGEST = 60_000  # bytes in a packet; LCM fragments larger ones
LARGE_ONE_IN = 20  # of these, only one in this many is sent


def flood(url: str, rate: float, seed: int) -> None:
    """Send `rate` messages a second until the process is ended."""
    bus, signatures, random = open_lcm(url), Signatures(key_of(url)), Random(seed)
    valid_signer = Signer(key_of(url))
    due = release = time.monotonic()
    sent = 0
    while os.getppid() != 1:
        channel, data = _one(random, signatures)
        if len(data) < LARGEST or random.randrange(LARGE_ONE_IN) == 0:
            bus.publish(channel, data)
            sent += 1
        if time.monotonic() >= release:
            release += RELEASE_EVERY_S
            released = message_of(ESTOP, 0, now_utime())
            released.engaged = False
            assert isinstance(released, estop_t)
            bus.publish(ESTOP.name, valid_signer.sign(ESTOP.name, released.encode()))
            print(sent, flush=True)
        due = max(due + 1.0 / rate, time.monotonic() - 0.1)
        time.sleep(max(due - time.monotonic(), 0.0))


def _one(random: Random, signatures: Signatures) -> tuple[str, bytes]:
    """Return a channel and the bytes to send on it."""
    draws = Draws(random.randbytes(LONGEST_DRAW))
    if random.randrange(30) == 0:  # channels that no process uses
        name = random.choice(
            ("POSE_01", "JUNK", f"JUNK_{random.randrange(10**6)}", "GYRO_99999999999", "\x1b[31m", "x" * 63)
        )
        return name, draws.choice(TEXTS).encode()[:1000]
    stream = random.choice(STREAMS)
    while random.randrange(RARE.get(stream, 1)):
        stream = random.choice(STREAMS)
    robot_id = random.choice((*ROBOTS, random.randrange(40)))
    channel = stream.channel(robot_id if stream.per_robot else None)
    return channel, signatures.of(draws, channel, fuzzed(draws, stream, robot_id, now_utime()))


if __name__ == "__main__":
    _, where, per_second, seed = sys.argv
    flood(where, float(per_second), int(seed))
