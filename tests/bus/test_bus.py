"""The bus keeps its promises on a real LCM bus: a private UDP port of the loopback."""

import itertools
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

import lcm
import pytest

from cmr.bus.bus import Bus
from cmr.bus.message import Message
from cmr.bus.messages import Received, make, now_utime
from cmr.bus.preflight import BusError
from cmr.bus.process import Process
from cmr.bus.streams import GYRO, MOTOR_COMMAND, PARAMETERS, PROCESS_STATUS
from cmr.msg import gyro_t, motor_command_t, process_status_t
from cmr.parameters.file import announcement
from tests.support.bus_bench import PATIENCE, our_command, receive_until
from tests.support.taken import open_files, threads
from tests.support.typed_messages import all_of, as_a

pytestmark = pytest.mark.real_time

STARTING, RUNNING, STOPPING = process_status_t.STARTING, process_status_t.RUNNING, process_status_t.STOPPING
TINY = """
import sys
from cmr.bus.process import Process
with Process("tiny", sys.argv[1]) as process:
    for _ in process.loop(rate_hz=50.0):
        pass
sys.exit(process.exit_code)
"""
FLOOD = """
import sys, lcm
from cmr.bus.messages import make
from cmr.msg import motor_command_t
bus = lcm.LCM(sys.argv[1])
message = make(motor_command_t, utime=1, robot_id=0, left=0.5, right=0.5).encode()
while True:
    bus.publish("MOTOR_COMMAND_0", message)
"""


def command(left: float, robot_id: int = 0) -> Any:
    return make(motor_command_t, utime=now_utime(), robot_id=robot_id, left=left, right=0.0)


@contextmanager
def running(arguments: list[str]) -> Iterator[subprocess.Popen[str]]:
    """Start a process of ours, and end it in any case."""
    process = subprocess.Popen(arguments, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


# What arrives


def test_bad_messages_are_counted_by_channel_and_reason_and_the_next_good_one_arrives(url: str) -> None:
    bus, sender = Bus(url), lcm.LCM(url)
    bus.subscribe(MOTOR_COMMAND)
    good = command(0.25).encode()
    sender.publish("MOTOR_COMMAND_0", good[:-3])
    sender.publish("MOTOR_COMMAND_0", b"")
    sender.publish(
        "MOTOR_COMMAND_0",
        make(gyro_t, utime=1, robot_id=0, yaw_rate=0.0, valid=1, received_utime=1).encode(),
    )
    sender.publish("MOTOR_COMMAND_3", good)
    sender.publish("MOTOR_COMMAND_03", good)
    sender.publish("MOTOR_COMMAND_0", good)
    [received] = receive_until(bus, bool)
    assert (received.robot_id, as_a(motor_command_t, received.message).left) == (0, 0.25)
    assert bus.rejected == {
        ("MOTOR_COMMAND_0", "corrupt"): 1,
        ("MOTOR_COMMAND_0", "foreign"): 2,
        ("MOTOR_COMMAND_3", "wrong_robot"): 1,
        ("MOTOR_COMMAND_03", "unknown_channel"): 1,
    }


def test_a_handler_gets_each_message_with_its_time_and_channel(url: str) -> None:
    sender = Bus(url)
    handled: list[tuple[int, str, Message]] = []
    with Process("tiny", url) as process:
        process.subscribe(MOTOR_COMMAND, every=True)
        sender.publish(MOTOR_COMMAND, command(0.5, robot_id=3), 3)
        deadline = time.monotonic() + PATIENCE
        for _ in process.loop(rate_hz=50.0):
            process.dispatch(lambda utime, channel, message: handled.append((utime, channel, message)))
            if handled or time.monotonic() > deadline:
                break
    [(utime, channel, message)] = handled
    assert (utime, channel) == (message.utime, "MOTOR_COMMAND_3")
    assert as_a(motor_command_t, message).left == 0.5


def test_what_was_not_taken_is_told_on_process_status(url: str) -> None:
    listener, sender = Bus(url), lcm.LCM(url)
    listener.subscribe(PROCESS_STATUS, every=True)
    with Process("tiny", url) as process:
        process.subscribe(MOTOR_COMMAND)
        sender.publish("MOTOR_COMMAND_0", b"nonsense")
        deadline = time.monotonic() + PATIENCE
        for _ in process.loop(rate_hz=50.0):
            if process.bus.rejected or time.monotonic() > deadline:
                break
    statuses = receive_until(listener, lambda all_: any(one.state == STOPPING for one in all_of(PROCESS_STATUS, all_)))
    assert all_of(PROCESS_STATUS, statuses)[-1].message == "Messages not taken: MOTOR_COMMAND_0 foreign 1."


def test_after_a_stall_a_controller_gets_the_latest_of_each_channel_only(url: str) -> None:
    bus, sender = Bus(url), Bus(url)
    bus.subscribe(MOTOR_COMMAND)
    for count in range(200):
        sender.publish(MOTOR_COMMAND, command(count), 0)
        sender.publish(MOTOR_COMMAND, command(-count, robot_id=1), 1)
    time.sleep(0.5)
    received = bus.receive(PATIENCE)
    assert [one.left for one in sorted(all_of(MOTOR_COMMAND, received), key=lambda one: one.robot_id)] == [199, -199]


def test_whoever_wants_every_message_gets_every_message_in_order(url: str) -> None:
    bus, sender = Bus(url), Bus(url)
    bus.subscribe(MOTOR_COMMAND, every=True)
    for count in range(200):
        sender.publish(MOTOR_COMMAND, command(count), 0)
    received = receive_until(bus, lambda all_: len(all_) >= 200)
    assert [one.left for one in all_of(MOTOR_COMMAND, received)] == list(range(200))


def test_a_slow_loop_gets_the_latest_only_even_while_it_listens(url: str) -> None:
    sender = Bus(url)
    stop = threading.Event()

    def send() -> None:
        count = 0
        while not stop.wait(0.01):
            count += 1
            sender.publish(MOTOR_COMMAND, command(count), 0)

    with Process("slow", url) as process:
        process.subscribe(MOTOR_COMMAND)
        thread = threading.Thread(target=send)
        thread.start()
        turns = [len(process.received()) for _, _turn in zip(range(6), process.loop(rate_hz=5.0), strict=False)]
        stop.set()
        thread.join()
    assert max(turns) == 1


def test_only_the_robot_and_the_streams_subscribed_to_arrive(url: str) -> None:
    bus, sender = Bus(url), Bus(url)
    bus.subscribe(MOTOR_COMMAND, 1)
    for robot_id in (11, 0, 1):
        sender.publish(MOTOR_COMMAND, command(0.5, robot_id), robot_id)
    sender.publish(GYRO, make(gyro_t, utime=1, robot_id=1, yaw_rate=0.0, valid=1, received_utime=1), 1)
    sender.publish(MOTOR_COMMAND, command(0.75, robot_id=1), 1)
    received = receive_until(bus, lambda all_: any(one.left == 0.75 for one in all_of(MOTOR_COMMAND, all_[-1:])))
    assert {one.channel for one in received} == {"MOTOR_COMMAND_1"}
    assert not bus.rejected


def test_a_late_joiner_gets_what_is_repeated_with_a_fresh_stamp(url: str) -> None:
    sender = Bus(url)
    sender.repeat(PARAMETERS, announcement(0, "text", 5), 0, period=0.1)
    sender.publish_repeated()
    joined = now_utime()
    late = Bus(url)
    late.subscribe(PARAMETERS)
    deadline = time.monotonic() + PATIENCE
    received: list[Received] = []
    while not received and time.monotonic() < deadline:
        sender.publish_repeated()
        received = late.receive(0.05)
    assert all_of(PARAMETERS, received)[0].yaml == "text"
    assert received[0].message.utime > joined


def test_what_is_repeated_is_sent_once_a_period_and_replaced_without_haste(url: str) -> None:
    sender, listener = Bus(url), Bus(url)
    listener.subscribe(PARAMETERS, every=True)
    for text in ("old", "new", "newest"):
        sender.repeat(PARAMETERS, announcement(0, text, 5), 0, period=30.0)
        sender.publish_repeated()
    sender.publish(PARAMETERS, announcement(1, "last", 5), 1)
    received = receive_until(listener, lambda all_: any(one.robot_id == 1 for one in all_))
    assert [one.yaml for one in all_of(PARAMETERS, received)] == ["old", "last"]


# The life of a process


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("arguments", [[sys.executable, "-c", TINY], [our_command("cmr-sim"), "--lcm-url"]])
def test_a_signal_ends_a_process_within_a_second_with_exit_code_130(
    url: str, arguments: list[str], number: signal.Signals
) -> None:
    listener = Bus(url)
    listener.subscribe(PROCESS_STATUS, every=True)
    with running([*arguments, url]) as process:
        receive_until(listener, lambda all_: any(one.state == RUNNING for one in all_of(PROCESS_STATUS, all_)))
        process.send_signal(number)
        began = time.monotonic()
        _, said = process.communicate(timeout=PATIENCE)
        assert time.monotonic() - began < 1.0
        assert process.returncode == 130
        news = [line for line in said.splitlines() if "ompil" not in line]  # which may come first, on a new computer
        assert {line.split()[-1] for line in news} <= {"ready", "stopped"}, said
    receive_until(listener, lambda all_: any(one.state == STOPPING for one in all_of(PROCESS_STATUS, all_)))


def test_a_process_reports_once_a_second_from_start_to_end(url: str) -> None:
    listener = Bus(url)
    listener.subscribe(PROCESS_STATUS, every=True)
    with running([sys.executable, "-c", TINY, url]) as process:
        received = receive_until(listener, lambda all_: len(all_) >= 6)
        process.terminate()
        received += receive_until(
            listener, lambda all_: any(one.state == STOPPING for one in all_of(PROCESS_STATUS, all_[-1:]))
        )
    statuses = all_of(PROCESS_STATUS, received)
    states = [status.state for status in statuses]
    assert states == [STARTING, *[RUNNING] * (len(states) - 2), STOPPING]
    assert {(status.process, status.host, status.pid) for status in statuses} == {
        ("tiny", socket.gethostname(), process.pid)
    }
    seconds = [(after.utime - before.utime) / 1e6 for before, after in itertools.pairwise(statuses[1:-1])]
    assert sum(seconds) / len(seconds) == pytest.approx(1.0, abs=0.3)
    assert all(20.0 < status.loop_rate_hz < 55.0 for status in statuses[2:-1])


def test_a_loop_body_that_stalls_is_counted_and_lost_turns_are_not_made_up(url: str) -> None:
    with Process("tiny", url) as process:
        began = time.monotonic()
        for turn, _ in enumerate(process.loop(rate_hz=20.0), start=1):
            if turn in (3, 5, 7):
                time.sleep(0.4)
            if turn == 12:
                break
        elapsed = time.monotonic() - began
    assert process.overruns >= 3
    assert elapsed > 3 * 0.4 + 8 * 0.04  # the eight other turns kept their distance
    assert process.exit_code == 0


def test_an_error_is_told_on_the_way_out_and_signals_are_as_before(url: str) -> None:
    listener = Bus(url)
    listener.subscribe(PROCESS_STATUS, every=True)
    handlers = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
    with suppress(RuntimeError), Process("tiny", url):
        raise RuntimeError("wheel fell off")
    with pytest.raises(BusError):
        Process("tiny", "nonsense").__enter__()
    assert handlers == [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
    statuses = receive_until(listener, lambda all_: any(one.state == STOPPING for one in all_of(PROCESS_STATUS, all_)))
    assert all_of(PROCESS_STATUS, statuses)[-1].message == "RuntimeError: wheel fell off"


def test_remarks_are_asked_for_only_when_a_report_is_made(url: str) -> None:
    listener = Bus(url)
    listener.subscribe(PROCESS_STATUS, every=True)
    asked: list[int] = []

    def remarks() -> str:
        asked.append(turn)
        return "Wheels turn."

    with Process("tiny", url) as process:
        process.message, process.remarks = "No poses.", remarks
        for turn, _ in enumerate(process.loop(rate_hz=200.0)):
            process.stopped_by_signal = turn == 100
    reports = len(asked)
    statuses = receive_until(listener, lambda all_: any(one.state == STOPPING for one in all_of(PROCESS_STATUS, all_)))
    told = [one.message for one in all_of(PROCESS_STATUS, statuses)]
    assert told[0] == ""
    assert set(told[1:]) == {"No poses. Wheels turn."}
    assert len(told) == 1 + reports
    assert reports < 20


def test_a_flood_neither_starves_the_loop_nor_deafens_it_to_signals(url: str) -> None:
    with (
        running([sys.executable, "-c", FLOOD, url]),
        running([sys.executable, "-c", FLOOD, url]),
        Process("flooded", url) as process,
    ):
        process.subscribe(MOTOR_COMMAND, every=True)
        deadline = time.monotonic() + PATIENCE
        while not process.bus.receive(0.1):
            assert time.monotonic() < deadline
        moments = [time.monotonic()]
        timer = threading.Timer(3.0, os.kill, (os.getpid(), signal.SIGTERM))
        timer.start()
        for _ in process.loop(rate_hz=10.0):
            process.received()
            moments.append(time.monotonic())
        ended = time.monotonic()
        timer.join()
    assert process.exit_code == 130
    assert ended - moments[0] < 3.0 + 1.0
    assert len(moments) >= 10  # of 30
    assert max(after - before for before, after in itertools.pairwise(moments)) < 1.0


@pytest.mark.parametrize("listens", [False, True])
def test_waiting_for_messages_takes_no_longer_than_asked(url: str, listens: bool) -> None:
    bus = Bus(url)
    if listens:
        bus.subscribe(MOTOR_COMMAND)
    began = time.monotonic()
    assert bus.receive(0.2) == []
    assert 0.19 < time.monotonic() - began < 1.0


# What the system gives


def test_a_bus_that_is_let_go_gives_its_thread_and_sockets_back(url: str) -> None:
    before = threads(), open_files()
    for _ in range(3):
        bus = Bus(url)
        bus.subscribe(MOTOR_COMMAND, every=True)
        assert (threads(), open_files()) > before
        del bus
        assert (threads(), open_files()) == before


def test_who_only_sends_has_no_thread_that_takes_what_others_send(url: str) -> None:
    before = threads()
    bus = Bus(url)
    bus.publish(MOTOR_COMMAND, command(0.5), 0)
    assert bus.receive(0.0) == []
    assert threads() == before
    bus.subscribe(MOTOR_COMMAND)
    assert threads() == before + 1
