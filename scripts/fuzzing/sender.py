"""Flood a bus with messages of every type, right ones and others: python -m fuzzing.sender URL RATE SEED [--key]."""

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

ROBOTS = (0, 0, 0, 0, 0, 10, 11, 12)  # the real one, virtual ones, and one that is none
LONGEST_DRAW = 150  # bytes
RARE = {
    ESTOP: 40,
    PARAMETERS: 5,
    COMMAND_CLAIM: 40,
    COMMAND_OWNER: 400,
    PROCESS_REQUEST: 5,
}  # so many times as rare: else nothing but them would be tried
RELEASE_EVERY = 5.0  # s; else the robot would stand for good
LARGEST = 60_000  # bytes of a packet; larger ones are sent in pieces, and one of these in so many
LARGE_ONE_IN = 20


def flood(url: str, rate: float, seed: int) -> None:
    """Send until a signal comes."""
    bus, signatures, random = open_lcm(url), Signatures(key_of(url)), Random(seed)
    honest = Signer(key_of(url))
    due = release = time.monotonic()
    sent = 0
    while os.getppid() != 1:
        channel, data = _one(random, signatures)
        if len(data) < LARGEST or random.randrange(LARGE_ONE_IN) == 0:
            bus.publish(channel, data)
            sent += 1
        if time.monotonic() >= release:
            release += RELEASE_EVERY
            free = message_of(ESTOP, 0, now_utime())
            free.engaged = False
            assert isinstance(free, estop_t)
            bus.publish(ESTOP.name, honest.sign(ESTOP.name, free.encode()))
            print(sent, flush=True)
        due = max(due + 1.0 / rate, time.monotonic() - 0.1)
        time.sleep(max(due - time.monotonic(), 0.0))


def _one(random: Random, signatures: Signatures) -> tuple[str, bytes]:
    """Return a channel and what to send on it."""
    draws = Draws(random.randbytes(LONGEST_DRAW))
    if random.randrange(30) == 0:  # channels of nobody
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
    _, where, per_second, chance = sys.argv
    flood(where, float(per_second), int(chance))
