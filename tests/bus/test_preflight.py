"""When the bus cannot be used, or not well, it is said in a sentence that tells what to do."""

import os
import shutil
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any, cast

import lcm
import pytest

from cmr.bus import preflight
from cmr.bus.bus import Bus
from cmr.bus.preflight import BusError, handled, open_lcm, resolve_url, self_test, warnings
from cmr.bus.process import Process
from cmr.bus.streams import PROCESS_STATUS
from cmr.cli.configuration import DEFAULT_URL
from tests.support.bus_bench import PATIENCE, our_command, receive_until
from tests.support.typed_messages import all_of

pytestmark = pytest.mark.real_time

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
    texts = [one.message for one in all_of(PROCESS_STATUS, receive_until(listener, lambda all_: len(all_) >= 4))]
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
        statuses = receive_until(
            listener, lambda all_: any(one.pid == process.pid for one in all_of(PROCESS_STATUS, all_))
        )
    finally:
        process.kill()
        process.wait()
    assert {one.process for one in all_of(PROCESS_STATUS, statuses) if one.pid == process.pid} == {"cmr-sim"}


def test_opening_memq_needs_no_network() -> None:
    assert open_lcm("memq://") is not None


class Interrupted:
    """An LCM whose waits end as given: 1 with a message, 0 without one, -1 as where a signal comes."""

    def __init__(self, *ends: int) -> None:
        self._ends = list(ends)

    def handle_timeout(self, _wait_ms: int) -> int:
        end = self._ends.pop(0)
        if end < 0:
            raise OSError("lcm_handle_timeout() returned -1")
        return end


def test_a_signal_while_lcm_waits_is_no_failure_of_the_bus_but_two_in_a_row_are() -> None:
    assert handled(cast(lcm.LCM, Interrupted(-1, 1)))
    assert not handled(cast(lcm.LCM, Interrupted(-1, 0)))
    with pytest.raises(OSError, match="returned -1"):
        handled(cast(lcm.LCM, Interrupted(-1, -1)))
