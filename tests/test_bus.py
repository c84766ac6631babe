"""The bus keeps its promises on a real LCM bus: a private UDP port of the loopback."""

import itertools
import os
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import lcm
import pytest

from cmr.bus import preflight
from cmr.bus.bus import Bus
from cmr.bus.messages import Received, make, now_utime
from cmr.bus.preflight import DEFAULT_URL, BusError, open_lcm, resolve_url, self_test, warnings
from cmr.bus.process import Process
from cmr.bus.streams import GYRO, MOTOR_COMMAND, PARAMETERS, PROCESS_STATUS
from cmr.msg import gyro_t, motor_command_t, process_status_t
from cmr.parameters.file import announcement

STARTING, RUNNING, STOPPING = process_status_t.STARTING, process_status_t.RUNNING, process_status_t.STOPPING
PATIENCE = 20.0  # s until something that must happen is given up; no promise is as slow as that
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
LOSE_THE_NETWORK = """
import subprocess, sys
from cmr.bus.process import Process
with Process("tiny", sys.argv[1]) as process:
    for turn, _ in enumerate(process.loop(rate_hz=100.0)):
        if turn == 5:
            subprocess.run(["ip", "route", "del", "224.0.0.0/4", "dev", "lo"], check=True)
        if process.bus.unsent:
            break
    print(process._full_message())
"""


def command(left: float, robot_id: int = 0) -> Any:
    return make(motor_command_t, utime=now_utime(), robot_id=robot_id, left=left, right=0.0)


def receive_until(bus: Bus, enough: Callable[[list[Received]], bool]) -> list[Received]:
    received: list[Received] = []
    deadline = time.monotonic() + PATIENCE
    while not enough(received):
        assert time.monotonic() < deadline, f"only {received[-5:]} arrived"
        received += bus.receive(0.1)
    return received


@contextmanager
def running(arguments: list[str]) -> Iterator[subprocess.Popen[str]]:
    """Start a process of ours, and end it in any case."""
    process = subprocess.Popen(arguments, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def our_command(name: str) -> str:
    return str(Path(sys.executable).parent / name)


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
    assert (received.robot_id, received.message.left) == (0, 0.25)
    assert bus.rejected == {
        ("MOTOR_COMMAND_0", "corrupt"): 1,
        ("MOTOR_COMMAND_0", "foreign"): 2,
        ("MOTOR_COMMAND_3", "wrong_robot"): 1,
        ("MOTOR_COMMAND_03", "unknown_channel"): 1,
    }


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
    statuses = receive_until(listener, lambda all_: any(one.message.state == STOPPING for one in all_))
    assert statuses[-1].message.message == "Messages not taken: MOTOR_COMMAND_0 foreign 1."


def test_after_a_stall_a_controller_gets_the_latest_of_each_channel_only(url: str) -> None:
    bus, sender = Bus(url), Bus(url)
    bus.subscribe(MOTOR_COMMAND)
    for count in range(200):
        sender.publish(MOTOR_COMMAND, command(count), 0)
        sender.publish(MOTOR_COMMAND, command(-count, robot_id=1), 1)
    time.sleep(0.5)
    received = bus.receive(PATIENCE)
    assert [one.message.left for one in sorted(received, key=lambda one: one.robot_id or 0)] == [199, -199]


def test_whoever_wants_every_message_gets_every_message_in_order(url: str) -> None:
    bus, sender = Bus(url), Bus(url)
    bus.subscribe(MOTOR_COMMAND, every=True)
    for count in range(200):
        sender.publish(MOTOR_COMMAND, command(count), 0)
    received = receive_until(bus, lambda all_: len(all_) >= 200)
    assert [one.message.left for one in received] == list(range(200))


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
    received = receive_until(bus, lambda all_: bool(all_) and all_[-1].message.left == 0.75)
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
    assert received[0].message.yaml == "text"
    assert received[0].message.utime > joined


def test_what_is_repeated_is_sent_once_a_period_and_replaced_without_haste(url: str) -> None:
    sender, listener = Bus(url), Bus(url)
    listener.subscribe(PARAMETERS, every=True)
    for text in ("old", "new", "newest"):
        sender.repeat(PARAMETERS, announcement(0, text, 5), 0, period=30.0)
        sender.publish_repeated()
    sender.publish(PARAMETERS, announcement(1, "last", 5), 1)
    received = receive_until(listener, lambda all_: any(one.robot_id == 1 for one in all_))
    assert [one.message.yaml for one in received] == ["old", "last"]


# What is said when the bus cannot be used


@pytest.mark.parametrize("given", ["udpm://[::1", "udpm://239.255.76.67:99999", "udpm://lab-robot:7667"])
def test_an_url_that_cannot_be_read_is_named_with_one_that_works(given: str) -> None:
    with pytest.raises(BusError) as error:
        Bus(given)
    assert "cannot be read" in str(error.value)
    assert repr(given) in str(error.value)
    assert DEFAULT_URL in str(error.value)


@pytest.mark.parametrize("option", ["ttl=x", "ttl=-1", "ttl=256", "recv_buf_size=-5", "recv_buf_size=4M"])
def test_a_wrong_option_of_the_url_is_named(option: str) -> None:
    with pytest.raises(BusError, match=f"{option.split('=')[0]} must be a whole number"):
        Bus(f"udpm://239.255.76.67:7667?{option}")


def test_an_address_that_is_not_multicast_is_named_with_the_range_to_use() -> None:
    with pytest.raises(BusError, match=r"192\.168\.0\.7 .*not a multicast address.*239\.0\.0\.0/8"):
        Bus("udpm://192.168.0.7:7667?ttl=1")


@pytest.mark.parametrize("given", ["nonsense", "http://239.255.76.67:7667", "file:///tmp/run.lcm", "udp://239.0.0.1:1"])
def test_an_url_of_another_kind_is_no_live_bus_and_one_that_works_is_shown(given: str) -> None:
    with pytest.raises(BusError, match="is not a live bus") as error:
        Bus(given)
    assert DEFAULT_URL in str(error.value)


def test_an_url_without_a_receive_buffer_is_warned_about_with_what_to_add(url: str) -> None:
    [sentence] = Bus(url.split("&")[0]).warnings
    assert "Add recv_buf_size=4194304" in sentence


def test_a_kernel_that_allows_too_small_a_buffer_is_warned_about_with_the_command(tmp_path: Path) -> None:
    rmem_max = tmp_path / "rmem_max"
    rmem_max.write_text("212992\n")
    [sentence] = warnings(DEFAULT_URL, rmem_max)
    assert "212992 bytes" in sentence
    assert "sudo sysctl -w net.core.rmem_max=4194304" in sentence
    rmem_max.write_text("4194304\n")
    assert warnings(DEFAULT_URL, rmem_max) == []
    assert warnings(DEFAULT_URL, tmp_path / "elsewhere") == []


def test_warnings_of_the_bus_stay_on_process_status_whatever_else_is_said(url: str) -> None:
    listener = Bus(url)
    listener.subscribe(PROCESS_STATUS, every=True)
    with Process("tiny", url.split("&")[0]) as process:
        process.message = "All is well."
        process.publish_status()
        process.message += " " + process.bus.warnings[0]
        process.publish_status()
    texts = [one.message.message for one in receive_until(listener, lambda all_: len(all_) >= 4)]
    assert [text.count("recv_buf_size=4194304") for text in texts] == [1, 1, 1, 1]
    assert texts[1].startswith("All is well.")


class DeafBus:
    """Accepts messages and never delivers one, like a bus behind a firewall."""

    def __init__(self) -> None:
        self.end, self.other_end = socket.socketpair()

    def fileno(self) -> int:
        return self.end.fileno()

    def subscribe(self, _channel: str, _handler: object) -> object:
        return None

    def unsubscribe(self, _subscription: object) -> None:
        return

    def publish(self, _channel: str, _data: bytes) -> None:
        return


def test_a_bus_that_swallows_messages_is_found_out_and_the_firewall_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(preflight, "SELF_TEST_SECONDS", 0.1)
    deaf: Any = DeafBus()
    with pytest.raises(BusError, match=r"did not come back.*firewall.*ip route get 239\.1\.2\.3`"):
        self_test(deaf, "udpm://239.1.2.3:7667?ttl=0")


def in_a_network_of_its_own(script: str) -> "subprocess.CompletedProcess[str]":
    """Run a shell script where there is no network but what it makes itself."""
    if not shutil.which("unshare") or not shutil.which("ip"):
        pytest.skip("unshare or ip is not installed here")
    if subprocess.run(["unshare", "-rn", "true"], capture_output=True, check=False).returncode != 0:
        pytest.skip("this machine does not let us make a network namespace")
    return subprocess.run(
        ["unshare", "-rn", "sh", "-ec", script], capture_output=True, text=True, timeout=PATIENCE, check=False
    )


def test_without_a_multicast_route_the_remedy_is_named_and_the_remedy_works(url: str) -> None:
    python = f"{sys.executable} -c 'import sys; from cmr.bus.bus import Bus; Bus(sys.argv[1])' '{url}'"
    without = in_a_network_of_its_own(f"ip link set lo up; {python}")
    assert without.returncode == 1
    sentence = without.stderr.strip().splitlines()[-1]
    assert "no network route for the multicast group 239.255.76.67" in sentence
    remedy = sentence.partition("Without a network: ")[2].replace("sudo ", "")
    assert remedy.startswith("ip link set lo multicast on && ip route add")
    cured = in_a_network_of_its_own(f"ip link set lo up; {remedy}; {python}")
    assert cured.returncode == 0, cured.stderr


def test_a_command_without_a_multicast_route_says_so_in_one_line_and_exits_with_1(url: str) -> None:
    result = in_a_network_of_its_own(f"{our_command('cmr-sim')} --lcm-url '{url}'")
    assert result.returncode == 1
    assert len(result.stderr.strip().splitlines()) == 1
    assert result.stderr.startswith("cmr-sim: This machine has no network route")


def test_a_network_that_is_lost_on_the_way_does_not_end_a_process(url: str, tmp_path: Path) -> None:
    script = tmp_path / "lose.py"
    script.write_text(LOSE_THE_NETWORK)
    network = "ip link set lo up; ip link set lo multicast on; ip route add 224.0.0.0/4 dev lo"
    result = in_a_network_of_its_own(f"{network}; {sys.executable} {script} '{url}'")
    assert result.returncode == 0, result.stderr
    assert result.stdout == "Messages not sent: Network is unreachable 1.\n"


def test_the_url_is_the_given_one_else_that_of_the_environment_else_stays_on_this_host(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("LCM_DEFAULT_URL", "udpm://239.1.1.1:1?ttl=1")
    assert resolve_url("udpm://239.2.2.2:2") == "udpm://239.2.2.2:2"
    assert resolve_url(None) == "udpm://239.1.1.1:1?ttl=1"
    monkeypatch.setenv("LCM_DEFAULT_URL", "")
    assert resolve_url(None) == DEFAULT_URL
    monkeypatch.delenv("LCM_DEFAULT_URL")
    assert resolve_url(None) == DEFAULT_URL == "udpm://239.255.76.67:7667?ttl=0&recv_buf_size=4194304"


def test_a_command_uses_the_bus_of_the_environment(url: str) -> None:
    listener = Bus(url)
    listener.subscribe(PROCESS_STATUS)
    environment = {**os.environ, "LCM_DEFAULT_URL": url}
    process = subprocess.Popen([our_command("cmr-sim")], env=environment, stderr=subprocess.DEVNULL)
    try:
        receive_until(listener, lambda all_: any(one.message.pid == process.pid for one in all_))
    finally:
        process.kill()
        process.wait()


def test_opening_memq_needs_no_network() -> None:
    assert open_lcm("memq://") is not None


# The life of a process


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("arguments", [[sys.executable, "-c", TINY], [our_command("cmr-sim"), "--lcm-url"]])
def test_a_signal_ends_a_process_within_a_second_with_exit_code_130(
    url: str, arguments: list[str], number: signal.Signals
) -> None:
    listener = Bus(url)
    listener.subscribe(PROCESS_STATUS, every=True)
    with running([*arguments, url]) as process:
        receive_until(listener, lambda all_: any(one.message.state == RUNNING for one in all_))
        process.send_signal(number)
        began = time.monotonic()
        _, said = process.communicate(timeout=PATIENCE)
        assert time.monotonic() - began < 1.0
        assert (process.returncode, said) == (130, "")
    receive_until(listener, lambda all_: any(one.message.state == STOPPING for one in all_))


def test_a_process_reports_once_a_second_from_start_to_end(url: str) -> None:
    listener = Bus(url)
    listener.subscribe(PROCESS_STATUS, every=True)
    with running([sys.executable, "-c", TINY, url]) as process:
        received = receive_until(listener, lambda all_: len(all_) >= 6)
        process.terminate()
        received += receive_until(listener, lambda all_: bool(all_) and all_[-1].message.state == STOPPING)
    statuses = [one.message for one in received]
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
    statuses = receive_until(listener, lambda all_: any(one.message.state == STOPPING for one in all_))
    assert statuses[-1].message.message == "RuntimeError: wheel fell off"


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


def test_waiting_for_messages_takes_no_longer_than_asked(url: str) -> None:
    bus = Bus(url)
    began = time.monotonic()
    assert bus.receive(0.2) == []
    assert 0.19 < time.monotonic() - began < 1.0
