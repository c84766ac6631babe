"""Turn the bytes of one fuzzer input into messages, valid and invalid, and pauses between them."""

from collections.abc import Sequence
from typing import Any

from cmr.bus.signing import Signer
from cmr.bus.streams import MOTOR_COMMAND, PROCESS_STATUS, Stream
from fuzzing.draws import Draws
from fuzzing.messages import fuzzed, message_of
from fuzzing.process_run import ProcessRun
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
    """Delivers inputs to a run: fuzzed messages of `stream`, among valid ones of all streams it subscribes to."""

    def __init__(self, run: ProcessRun, stream: Stream[Any], key: bytes | None) -> None:
        self._run, self._stream = run, stream
        self._streams: Sequence[Stream[Any]] = list(run.subscribed_streams().values())
        self._signatures, self._valid_signer = Signatures(key, lambda: run.utime), Signer(key, lambda: run.utime)
        self._last: tuple[str, bytes] | None = None

    def give(self, data: bytes) -> None:
        """Carry out the actions that an input encodes, and let the process run on for 20 ms."""
        draws = Draws(data)
        for _ in range(MOST_ACTIONS):
            if not draws.are_left or self._run.has_ended:
                break
            self._act(draws)
            pause = draws.choice(PAUSES)
            if draws.one_in(60):
                pause = draws.choice(LONG_PAUSES)
            self._run.advance(pause)
        self._run.advance(0.02)

    def _act(self, draws: Draws) -> None:
        kind = draws.below(9)
        if kind < 4:
            self._deliver_fuzzed(draws, self._stream)
        elif kind == 4 and self._last is not None:
            self._run.deliver(*self._last)
        elif kind == 5:
            self._deliver_valid(draws, self._stream)
        elif kind in (6, 7):
            self._deliver_valid(draws, draws.choice(self._streams))
        elif kind == 8 and draws.one_in(8):
            self._run.set_clock(draws.choice(CLOCK_SETS))

    def _deliver_fuzzed(self, draws: Draws, stream: Stream[Any]) -> None:
        robot_id = draws.choice(ROBOTS)
        channel = stream.channel(robot_id if stream.per_robot else None)
        data = self._signatures.of(draws, channel, fuzzed(draws, stream, robot_id, self._run.utime))
        self._last = channel, data
        self._run.deliver(channel, data)

    def _deliver_valid(self, draws: Draws, stream: Stream[Any]) -> None:
        message = message_of(stream, 0, self._run.utime)
        if stream is MOTOR_COMMAND:
            message.left, message.right = draws.choice(DUTIES), draws.choice(DUTIES)
        elif stream is PROCESS_STATUS:
            message.pid = FIRST_PID + draws.below(PIDS)
        if hasattr(message, "engaged"):
            message.engaged = draws.one_in(4)
        channel = stream.channel(0 if stream.per_robot else None)
        self._run.deliver(channel, self._valid_signer.sign(channel, message.encode()))
