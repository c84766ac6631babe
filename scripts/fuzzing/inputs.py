"""What one input of the fuzzer stands for: some messages, right ones and others, and time that passes between them."""

from collections.abc import Sequence
from typing import Any

from cmr.bus.signing import Signer
from cmr.bus.streams import MOTOR_COMMAND, PROCESS_STATUS, Stream
from fuzzing.draws import Draws
from fuzzing.life import Life
from fuzzing.messages import fuzzed, message_of
from fuzzing.signatures import Signatures

LONGEST = 200  # bytes of an input
MOST_ACTIONS = 8
PAUSES = (0.0, 0.0, 0.0, 0.0, 0.005, 0.005, 0.01, 0.02, 0.05)  # s
LONG_PAUSES = (0.6, 1.5, 3.0)  # s
CLOCK_SETS = (-3_600_000_000, 3_600_000_000, -400_000, 400_000)  # us
ROBOTS = (0, 0, 0, 0, 10, 11, 12, 1)
DUTIES = (0.0, 0.0, 0.3, 0.5, -0.5, 1.0)
FIRST_PID, PIDS = 1000, 8


class Inputs:
    """Gives inputs to a life: of a `stream`, among others that the process hears."""

    def __init__(self, life: Life, stream: Stream[Any], key: bytes | None) -> None:
        self._life, self._stream = life, stream
        self._heard: Sequence[Stream[Any]] = list(life.heard().values())
        self._signatures, self._honest = Signatures(key, lambda: life.utime), Signer(key, lambda: life.utime)
        self._last: tuple[str, bytes] | None = None

    def give(self, data: bytes) -> None:
        """Do what an input stands for, and let the process live on for a moment."""
        draws = Draws(data)
        for _ in range(MOST_ACTIONS):
            if not draws.are_left or self._life.is_over:
                break
            self._act(draws)
            pause = draws.choice(PAUSES)
            if draws.one_in(60):
                pause = draws.choice(LONG_PAUSES)
            self._life.advance(pause)
        self._life.advance(0.02)

    def _act(self, draws: Draws) -> None:
        kind = draws.below(9)
        if kind < 4:
            self._bring_fuzzed(draws, self._stream)
        elif kind == 4 and self._last is not None:
            self._life.bring(*self._last)
        elif kind == 5:
            self._bring_good(draws, self._stream)
        elif kind in (6, 7):
            self._bring_good(draws, draws.choice(self._heard))
        elif kind == 8 and draws.one_in(8):
            self._life.set_clock(draws.choice(CLOCK_SETS))

    def _bring_fuzzed(self, draws: Draws, stream: Stream[Any]) -> None:
        robot_id = draws.choice(ROBOTS)
        channel = stream.channel(robot_id if stream.per_robot else None)
        data = self._signatures.of(draws, channel, fuzzed(draws, stream, robot_id, self._life.utime))
        self._last = channel, data
        self._life.bring(channel, data)

    def _bring_good(self, draws: Draws, stream: Stream[Any]) -> None:
        message = message_of(stream, 0, self._life.utime)
        if stream is MOTOR_COMMAND:
            message.left, message.right = draws.choice(DUTIES), draws.choice(DUTIES)
        elif stream is PROCESS_STATUS:
            message.pid = FIRST_PID + draws.below(PIDS)
        if hasattr(message, "engaged"):
            message.engaged = draws.one_in(4)
        channel = stream.channel(0 if stream.per_robot else None)
        self._life.bring(channel, self._honest.sign(channel, message.encode()))
