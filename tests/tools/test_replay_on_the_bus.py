"""cmr-replay as a user has it: on a bus, in a terminal and without one."""

import os
import signal
import termios
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import lcm
import pytest

from cmr.bus.messages import decode, make, now_utime
from cmr.bus.streams import SELF_TESTS
from cmr.cli.errors import CommandError
from cmr.cli.progress import Progress
from cmr.cli.stopping import Stopping, stopped_by_signals
from cmr.msg import pose_xyt_t
from cmr.recordings.events import Event, EventReader
from cmr_tools.replay.main import main, play
from cmr_tools.replay.player import Player
from cmr_tools.replay.tape import LogTape
from cmr_tools.replay.terminal import Keys, parse_keys
from tests.support.typed_messages import as_a

pytestmark = pytest.mark.real_time

MESSAGES = 2000
LOGGED = 1_700_000_000_000_000  # us


def write_log(path: Path, count: int, period: int = 1000) -> Path:
    """Write poses of the robots 0 and 1 by turns, one each `period` [us]."""
    log = lcm.EventLog(str(path), "w", overwrite=True)
    for number in range(count):
        utime, robot_id = LOGGED + period * number, number % 2
        message = make(pose_xyt_t, utime=utime, robot_id=robot_id, x=float(number), y=0.0, theta=0.0)
        log.write_event(utime, f"POSE_{robot_id}", message.encode())
    log.close()
    return path


class Listener:
    """Notes what arrives on a bus, in a thread; a context manager."""

    def __init__(self, url: str) -> None:
        self.arrived: list[tuple[str, bytes]] = []
        self._lcm = lcm.LCM(url)
        self._lcm.subscribe(".*", lambda channel, data: self.arrived.append((channel, data))).set_queue_capacity(0)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._listen)

    def __enter__(self) -> "Listener":
        self._thread.start()
        return self

    def __exit__(self, *_error: object) -> None:
        self._ended.set()
        self._thread.join()

    def messages(self, count: int) -> list[tuple[str, bytes]]:
        """Wait until so many messages have arrived; return them, without tests of the bus."""
        deadline = time.monotonic() + 10.0
        while True:
            arrived = [entry for entry in self.arrived if entry[0] not in SELF_TESTS]
            if len(arrived) >= count or time.monotonic() > deadline:
                return arrived
            time.sleep(0.005)

    def _listen(self) -> None:
        while not self._ended.is_set():
            self._lcm.handle_timeout(20)


def test_a_log_arrives_complete_and_in_order_at_speed_10(url: str, tmp_path: Path) -> None:
    path = write_log(tmp_path / "run.lcm", MESSAGES)
    began = time.monotonic()
    with Listener(url) as listener:
        assert main([str(path), "--lcm-url", url, "--speed", "10"]) == 0
        arrived = listener.messages(MESSAGES)
    assert time.monotonic() - began >= (MESSAGES - 1) * 1e-3 / 10.0
    assert arrived == [(event.channel, event.data) for event in lcm.EventLog(str(path), "r")]


def test_messages_can_be_chosen_renamed_and_moved_to_now(url: str, tmp_path: Path) -> None:
    path = write_log(tmp_path / "run.lcm", 20)
    options = ["--channel", "POSE_*", "--without", "POSE_1", "--remap", "POSE_0=POSE_7", "--now", "--speed", "max"]
    before = now_utime()
    with Listener(url) as listener:
        assert main([str(path), "--lcm-url", url, *options]) == 0
        arrived = listener.messages(10)
    messages = [as_a(pose_xyt_t, decode(channel, data).message) for channel, data in arrived]
    assert [message.x for message in messages] == [float(number) for number in range(0, 20, 2)]
    assert {message.robot_id for message in messages} == {7}
    assert all(before <= message.utime <= now_utime() for message in messages)


def test_a_channel_to_rename_that_is_not_replayed_is_told(
    url: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_log(tmp_path / "run.lcm", 4)
    options = ["--remap", "POSE_9=POSE_7", "--remap", "POSE_0=OTHER", "--speed", "max"]
    assert main([str(path), "--lcm-url", url, *options]) == 0
    assert capsys.readouterr().err == "cmr-replay: POSE_9 of --remap was not among what was replayed.\n"


def test_a_filter_that_nothing_fits_names_the_channels(url: str, tmp_path: Path) -> None:
    path = write_log(tmp_path / "run.lcm", 4)
    with pytest.raises(CommandError, match=r"No channel of .*run\.lcm fits .* it has POSE_0, POSE_1\."):
        main([str(path), "--lcm-url", url, "--channel", "GYRO_*"])
    with pytest.raises(CommandError, match="holds no messages from 100 s on"):
        main([str(path), "--lcm-url", url, "--start", "100"])


@pytest.mark.parametrize(
    "options",
    [
        *(["--speed", "0.01"], ["--speed", "fast"], ["--speed", "nan"], ["--start", "-1"], ["--remap", "A"]),
        ["--remap", "POSE_0=WORLD_STATE"],
    ],
)
def test_wrong_options_are_wrong_usage(options: list[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(["run.lcm", *options])


def test_keys_have_names() -> None:
    assert parse_keys(b" +\x1b[C\x1bOD-q\x1b") == [" ", "+", "right", "left", "-", "q", "\x1b"]


@pytest.fixture
def terminal() -> Iterator[tuple[int, int]]:
    """A pseudo-terminal: the person's end, and the program's."""
    person, program = os.openpty()
    yield person, program
    os.close(person)
    os.close(program)


class Shown(Progress):
    """Keeps the texts that were shown."""

    def __init__(self) -> None:
        super().__init__()
        self.texts: list[str] = []

    def show(self, text: str | None = None, done: float | None = None) -> None:
        self.texts.append(text or "")
        super().show(text, done)


def test_in_a_terminal_keys_are_obeyed_and_a_status_line_is_shown(terminal: tuple[int, int], tmp_path: Path) -> None:
    person, program = terminal
    sent: list[Event] = []
    tape = LogTape(EventReader(write_log(tmp_path / "run.lcm", 60, period=1_000_000)))
    player = Player(tape, lambda: 0.0, lambda event, _due, _speed: sent.append(event))
    before = termios.tcgetattr(program)
    progress = Shown()
    with Keys(program) as keys:
        os.write(person, b" +\x1b[C-=q")
        play(player, keys, progress, 59.0, Stopping())
    assert termios.tcgetattr(program) == before, "the terminal is left as it was"
    assert (player.paused, player.position, player.speed, len(sent)) == (True, 10.0, 2.0, 1)
    assert progress.texts[0].startswith("playing 0.0 of 59.0 s, speed 1, 1 messages  [space: pause")


def test_without_a_terminal_there_are_no_keys() -> None:
    reader, writer = os.pipe()
    with Keys(reader) as keys:
        assert not keys.available
    os.close(reader)
    os.close(writer)


def test_a_signal_asks_to_end_and_raises_nothing() -> None:
    with stopped_by_signals() as stopping:
        assert not stopping
        os.kill(os.getpid(), signal.SIGTERM)
        assert stopping
