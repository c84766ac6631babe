"""What excuses tests that keep time excuses them only while the machine stands still."""

import os
import signal
import time

import pytest

from robot_driver.controllers import BadReply, Request
from robot_driver.serial_port import SerialPort
from tests.support.exchanges import Exchanges
from tests.support.stalls import Interval, Stalls

pytestmark = pytest.mark.real_time

PAUSE = 0.05  # s
UNHEARD = Request[None]("test", b"x", 1, lambda _reply: 1, lambda _reply: None)


@pytest.fixture
def paused(stalls: Stalls) -> Interval:
    """A time in which the watching process gets no processor, as if there were none."""
    begin = time.monotonic()
    os.kill(stalls.pid, signal.SIGSTOP)
    time.sleep(PAUSE)
    os.kill(stalls.pid, signal.SIGCONT)
    return Interval(begin, begin + PAUSE)


def test_what_fell_into_a_stall_is_excused_and_nothing_else(stalls: Stalls, paused: Interval) -> None:
    before_all = Interval(-2.0, -1.0)
    assert stalls.excused([before_all, paused], of=2) == [paused]


def test_on_a_machine_that_stands_still_most_of_the_time_nothing_is_excused(stalls: Stalls, paused: Interval) -> None:
    with pytest.raises(AssertionError, match="too often"):
        stalls.excused([paused], of=1)


def test_exchanges_that_fail_though_the_machine_runs_are_not_excused(exchanges: Exchanges, silent_port: str) -> None:
    port = SerialPort(silent_port, 115200)
    port.open()
    for _ in range(5):
        with pytest.raises(BadReply):
            port.exchange(UNHEARD)
    port.close()
    with pytest.raises(AssertionError):
        exchanges.assert_only_stalls_failed()
