"""cmr relay: sign messages of programs without keys, such as a motion capture system's."""

import argparse
import time
from fnmatch import fnmatchcase

from cmr.bus.bus import DRAIN_SECONDS
from cmr.bus.messages import RejectedMessage, decode
from cmr.bus.preflight import handled, open_lcm
from cmr.bus.process import Process
from cmr.bus.rejections import Rejections
from cmr.cli.command_line import parser

RATE = 200.0  # Hz
PRIVATE_BUS = "udpm://239.255.76.67:7668?ttl=0&recv_buf_size=4194304"
NOT_CHOSEN = "not_chosen"


class Relay:
    """Forwards messages of one bus to another process's bus; `rejected` counts what it does not forward."""

    def __init__(self, process: Process, channels: list[str]) -> None:
        self.rejected = Rejections()
        self.handed_on = 0
        self._process, self._channels = process, channels

    def take(self, channel: str, data: bytes) -> None:
        """Forward an encoded message, from any sender."""
        if not any(fnmatchcase(channel, pattern) for pattern in self._channels):
            self.rejected.note(channel, NOT_CHOSEN)
            return
        try:
            received = decode(channel, data)
        except RejectedMessage as rejected:
            self.rejected.note(channel, rejected.reason)
        else:
            self._process.publish(received.stream, received.message, received.robot_id)
            self.handed_on += 1

    def sentence(self) -> str:
        """Return a sentence on what was forwarded and rejected."""
        rejected = ", ".join(f"{channel} {reason} {count}" for (channel, reason), count in self.rejected.items())
        return f"{self.handed_on} messages handed on.{f' Not handed on: {rejected}.' if rejected else ''}"


def main(arguments: list[str]) -> int:
    """Run cmr relay. Raises BusError when one of the buses cannot be used, KeyFileError when the key cannot."""
    options = command_parser().parse_args(arguments)
    source = open_lcm(options.source)
    with Process("cmr relay", options.lcm_url) as process:
        relay = Relay(process, options.channel)
        source.subscribe(".*", relay.take).set_queue_capacity(0)  # unlimited
        for _ in process.loop(RATE):
            enough = time.monotonic() + DRAIN_SECONDS
            while handled(source) and time.monotonic() < enough:
                pass
            process.message = relay.sentence()
        return process.exit_code


def command_parser() -> argparse.ArgumentParser:
    """Return the command line of cmr relay."""
    result = parser(
        "cmr relay",
        "Sign messages of programs without keys, such as a motion capture system's: they send on a bus of this "
        "computer, and the relay sends what fits --channel on the shared one, signed by this computer's "
        "key.\n\nAnybody who can send on the bus of --from can then send on these channels. Name only those that are "
        "needed.",
        "cmr relay --channel 'POSE_*'",
    )
    result.add_argument(
        "--channel",
        action="append",
        required=True,
        metavar="PATTERN",
        help="channels to forward, such as 'POSE_*'; may be repeated",
    )
    result.add_argument(
        "--from", dest="source", default=PRIVATE_BUS, metavar="URL", help="LCM bus on which these programs send"
    )
    return result
