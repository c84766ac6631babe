"""Rows of signatures: the cost of signing and verifying a message."""

import os
from collections.abc import Callable, Iterator
from functools import partial

from benchmarks.report import Row, seconds
from benchmarks.timing import clocked, in_turns
from cmr.bus.signing import KEY_BYTES, Signer, Verifier

SIZES = (40, 1_400)  # bytes of a motor command, and of the largest message in one packet
LONGEST = 20e-6  # s, signed and verified
CHANNEL = "MOTOR_COMMAND_0"


def signing() -> Iterator[Row]:
    """Measure signing a message, and signing and verifying it; no result is cached between repetitions."""
    key = os.urandom(KEY_BYTES)
    for size in SIZES:
        data = os.urandom(size)
        signer, verifier = Signer(key), Verifier(key)

        def signed_and_verified(data: bytes = data, signer: Signer = signer, verifier: Verifier = verifier) -> object:
            return verifier.verify(CHANNEL, signer.sign(CHANNEL, data))

        works: dict[str, Callable[[], object]] = {
            "sign": partial(signer.sign, CHANNEL, data),
            "both": signed_and_verified,
        }
        sign, both = in_turns({name: clocked(work) for name, work in works.items()}).values()
        yield Row(
            f"a message of {size:,} bytes: signed; signed and verified",
            f"{seconds(sign)}; {seconds(both)}",
            "-",
            f"together {LONGEST * 1e6:g} us",
            both.median <= LONGEST,
        )
