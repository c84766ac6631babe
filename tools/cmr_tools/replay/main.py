"""cmr-replay: send the messages of an event log on the bus again, as they were sent when it was recorded.

Usage: cmr-replay RUN.lcm
"""

import argparse
import math
import sys
import time
from collections import Counter

import lcm

from cmr.bus.messages import now_utime
from cmr.bus.preflight import key_of, open_lcm, resolve_url, self_test
from cmr.bus.process import EXIT_INTERRUPTED
from cmr.bus.signing import Signer, without_signature
from cmr.bus.streams import LCM_CHANNEL_NAME_LIMIT, MOTOR_COMMAND, identify
from cmr.cli.command_line import add_channels, add_logs, add_without, logs_of, parse_seconds, parser
from cmr.cli.errors import CommandError
from cmr.cli.progress import Progress
from cmr.cli.stopping import Stopping, stopped_by_signals
from cmr.recordings.events import Event, EventReader
from cmr_tools.events import damage_sentence, open_log
from cmr_tools.replay.changes import Changes, ChannelFilter, moved_to
from cmr_tools.replay.player import SLOWEST, Player
from cmr_tools.replay.tape import LogTape
from cmr_tools.replay.terminal import Keys

JUMP = 10.0  # s
LONGEST_WAIT = 0.1  # s; a signal is noticed within this time
KEYS = "space: pause, + -: speed, arrows: 10 s, q: quit"


class Sender:
    """Sends messages on the bus, with the requested changes; `unsent` counts failures by reason.

    Those that are sent `as_of_now` get a new signature.
    """

    def __init__(self, bus: lcm.LCM, changes: Changes, signer: Signer, *, as_of_now: bool) -> None:
        self._signer = signer
        self.unsent: Counter[str] = Counter()
        self._warned = False
        self._bus, self._changes, self._as_of_now = bus, changes, as_of_now
        self._clock_began = now_utime() - time.monotonic() * 1e6  # us since the Unix epoch

    def send(self, event: Event, due: float, speed: float) -> None:
        """Send a message that is due at this time of the monotonic clock [s]."""
        new_utime = None
        if self._as_of_now:
            new_utime = moved_to(round(self._clock_began + due * 1e6), event.utime, speed)
        channel, data = self._changes.changed(event, new_utime)
        if self._as_of_now:
            data = self._signer.sign(channel, without_signature(data))
        if self._as_of_now and not self._warned and channel.startswith(MOTOR_COMMAND.name):
            self._warned = True
            print(f"cmr-replay: {channel} is sent as new: a robot that is on the bus moves.", file=sys.stderr)
        try:
            self._bus.publish(channel, data)
        except OSError as error:  # Wi-Fi that drops out, or a message too large for a packet
            self.unsent[error.strerror or str(error)] += 1


def main(arguments: list[str]) -> int:
    """Replay one log.

    Raises CommandError if there is nothing to replay, BusError if the bus cannot be used.
    """
    options = _parse(arguments)
    log = open_log(options.log)
    url = resolve_url(options.lcm_url)
    signer = Signer(key_of(url))
    sender = Sender(_bus(url), Changes(dict(options.remap)), signer, as_of_now=options.now)
    chosen = ChannelFilter(options.channel, options.without)
    tape = LogTape(log)
    player = Player(
        tape,
        time.monotonic,
        sender.send,
        speed=options.speed,
        loop=options.loop,
        longest_gap=options.skip_gaps,
        begin=options.start,
        end=options.stop,
        wanted=chosen,
    )
    duration = min(tape.duration() or math.inf, options.stop)
    with stopped_by_signals() as stopping, Keys(0) as keys, Progress() as progress:
        play(player, keys, progress, duration, stopping)
    interrupted = bool(stopping)
    print("\n".join(_summary(player, sender, log)))
    for old in [old for old, _new in options.remap if not chosen.seen.get(old)]:
        print(f"cmr-replay: {old} of --remap was not among what was replayed.", file=sys.stderr)
    if not player.sent and not interrupted:
        raise _nothing(options, chosen)
    return EXIT_INTERRUPTED if interrupted else 0


def command_parser() -> argparse.ArgumentParser:
    """Return the command line of cmr-replay."""
    result = parser(
        "cmr-replay",
        "Send the messages of an event log on the bus again, at the times at which they were logged. In a terminal, "
        "keys control it: space pauses, + and - change the speed, the arrows left and right jump 10 s, q quits.\n\n"
        "Times inside the messages stay as recorded, and so do signatures, which processes with a key refuse as stale, "
        "unless --now is given. Beware: with --now, "
        "the motor commands of the log move a robot that is on the bus.",
        "cmr-replay run.lcm --speed 10 --channel 'POSE_*'\n"
        "  cmr-replay run.lcm --start 30 --stop 60 --loop --now --without 'MOTOR_COMMAND_*'\n"
        "  cmr-replay run.lcm --remap POSE_0=POSE_7",
    )
    add_logs(result, "event log, as lcm-logger or cmr-run writes it", single=True)
    result.add_argument(
        "--speed", type=_speed, default=1.0, help=f"{SLOWEST} or more times as fast; max: as fast as can be"
    )
    _add_span(result)
    result.add_argument(
        "--now",
        action="store_true",
        help="move the times in the messages (utime, received_utime) to the present, so that processes take them for "
        "new; ages stay as they were, or shrink with a higher speed",
    )
    add_channels(result)
    add_without(result)
    _add_remap(result)
    return result


def _parse(arguments: list[str]) -> argparse.Namespace:
    result = command_parser()
    options = result.parse_args(arguments)
    logs = logs_of(options)
    if len(logs) != 1:
        result.error("name one event log")
    [options.log] = logs
    for bound in ("stop", "skip_gaps"):
        if getattr(options, bound) is None:
            setattr(options, bound, math.inf)
    if options.stop <= options.start:
        result.error("--stop must be later than --start")
    return options


def _add_span(result: argparse.ArgumentParser) -> None:
    """Add options for the part of the log to play, repeats, and the length of gaps."""
    result.add_argument(
        "--start",
        type=parse_seconds,
        default=0.0,
        metavar="S",
        help="where to begin, from the beginning of the log",
    )
    result.add_argument(
        "--stop",
        type=parse_seconds,
        metavar="S",
        help="where to end, from the beginning of the log; else at its end",
    )
    result.add_argument("--loop", action="store_true", help="begin again at the end, until stopped")
    result.add_argument("--skip-gaps", type=parse_seconds, metavar="S", help="cut every longer silence to this")


def _add_remap(result: argparse.ArgumentParser) -> None:
    result.add_argument(
        "--remap",
        type=_remap,
        action="append",
        default=[],
        metavar="OLD=NEW",
        help="send a channel under another name; from POSE_0 to POSE_7 the messages speak of robot 7, too; may be "
        "given again. --channel and --without mean the names in the log",
    )


def _speed(text: str) -> float:
    speed = math.inf if text == "max" else _number(text)
    if not speed >= SLOWEST:
        raise argparse.ArgumentTypeError(f"{text!r} is not a speed: a number of {SLOWEST} or more, or max")
    return speed


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


def _remap(text: str) -> tuple[str, str]:
    old, equals, new = text.partition("=")
    if not (old and equals and 0 < len(new.encode()) <= LCM_CHANNEL_NAME_LIMIT):
        raise argparse.ArgumentTypeError(
            f"{text!r} is not OLD=NEW: two channel names, the new one of at most {LCM_CHANNEL_NAME_LIMIT} bytes"
        )
    carried, expected = identify(old), identify(new)
    if carried and expected and carried[0] is not expected[0]:
        raise argparse.ArgumentTypeError(f"{old} carries other messages than {new}: nobody would take them")
    return old, new


def _bus(url: str | None) -> lcm.LCM:
    """Return a working bus for sending only."""
    resolved = resolve_url(url)
    self_test(open_lcm(resolved), resolved)
    return open_lcm(resolved)


def play(player: Player, keys: Keys, progress: Progress, duration: float, stopping: Stopping) -> None:
    """Play a log of `duration` [s] until its end, the key q or a signal."""
    while not stopping:
        wait = player.play()
        if wait is None:
            break
        progress.show(_status(player, duration, keys.available))
        for key in keys.wait(min(wait, LONGEST_WAIT)):
            if key == "q":
                return
            _obey(player, key)


def _obey(player: Player, key: str) -> None:
    match key:
        case " ":
            player.toggle()
        case "+" | "=":  # the same key, on many keyboards
            player.faster()
        case "-":
            player.slower()
        case "right":
            player.jump(JUMP)
        case "left":
            player.jump(-JUMP)


def _status(player: Player, duration: float, has_keys: bool) -> str:
    of = f" of {duration:.1f}" if math.isfinite(duration) else ""
    speed = "max" if math.isinf(player.speed) else f"{player.speed:g}"
    doing = "paused " if player.paused else "playing"
    rounds = f", round {player.rounds + 1}" if player.rounds else ""
    text = f"{doing} {player.position:.1f}{of} s, speed {speed}{rounds}, {player.sent} messages"
    return f"{text}  [{KEYS}]" if has_keys else text


def _summary(player: Player, sender: Sender, log: EventReader) -> list[str]:
    unsent = [f"{count} of them could not be sent: {why}." for why, count in sender.unsent.items()]
    sent = f"{player.sent} messages of {log.path}, up to {player.position:.1f} s."
    return [line for line in (sent, *unsent, damage_sentence(log)) if line]


def _nothing(options: argparse.Namespace, chosen: ChannelFilter) -> CommandError:
    """Return an error that says why there was nothing to replay."""
    if not chosen.seen:
        return CommandError(f"{options.log} holds no messages from {options.start:g} s on.")
    if any(chosen.seen.values()):
        return CommandError(f"{options.log} holds no such messages in the time that was asked for.")
    return CommandError(
        f"No channel of {options.log} fits --channel and --without; it has {', '.join(sorted(chosen.seen))}."
    )
