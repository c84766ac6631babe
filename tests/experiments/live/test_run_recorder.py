"""A log of a run has each message at the time at which it came, and an error of the recorder is told."""

import time
from pathlib import Path

import lcm
import numpy as np
import pytest

from cmr.experiments.live.recorder import Recorder
from tests.support.private_bus import private_url

pytestmark = pytest.mark.waits

COUNT = 30
PERIOD = 0.01  # s


def test_each_message_is_logged_when_it_comes(tmp_path: Path) -> None:
    url = private_url()
    recorder, bus = Recorder(tmp_path / "run.lcm", url), lcm.LCM(url)
    sent = []
    for k in range(COUNT):
        sent.append(time.time())
        bus.publish("COUNT", bytes([k]))
        time.sleep(PERIOD)
    recorder.check()
    recorder.close()
    events = [event for event in lcm.EventLog(str(tmp_path / "run.lcm"), "r") if event.channel == "COUNT"]
    assert [event.data for event in events] == [bytes([k]) for k in range(COUNT)]
    late = np.array([event.timestamp for event in events]) * 1e-6 - np.array(sent)
    assert np.median(late) < 0.5 * PERIOD  # the median, as the machine may hold up either of the two


def test_a_recorder_that_cannot_write_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    url = private_url()
    recorder, bus = Recorder(tmp_path / "run.lcm", url), lcm.LCM(url)
    monkeypatch.setattr("cmr.experiments.live.recorder.now_utime", lambda: 1 // 0)
    bus.publish("COUNT", b"1")
    deadline = time.monotonic() + 10.0
    while recorder.is_well and time.monotonic() < deadline:
        time.sleep(0.01)
    with pytest.raises(ZeroDivisionError):
        recorder.check()
    recorder.close()
