"""cmr-view plots any signal over time, live and of a log, in bounded memory; spikes and silences are seen."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cmr.bus.fields import FieldName
from cmr.bus.messages import make
from cmr.bus.streams import CAMERA_IMAGE, STREAMS
from cmr.bus.world_state import WorldState
from cmr.msg import gyro_t
from cmr.recordings.events import Event, EventReader, event_bytes
from cmr.view.curves import MOST_SIGNALS, WHOLE, Curve, LiveCurves, LogCurves
from cmr.view.log_index import LogIndex
from cmr.view.plots import PIXELS, columns, title
from cmr.view.robots import REAL, TWIN, VIRTUAL, RobotTable
from cmr.view.signals import Source, sources

NOW = 1_700_000_000_000_000  # us
SECOND = 1_000_000  # us
RATE = FieldName("GYRO_0", "yaw_rate")


def reading(utime: int, rate: float) -> bytes:
    message = make(gyro_t, utime=utime, robot_id=0, yaw_rate=rate, valid=1, received_utime=utime)
    return bytes(message.encode())


def world(utime: int) -> WorldState:
    """Robot 0, its twin and robot 7, at x = 0, 1 and 7 m."""
    x = np.array([0.0, 1.0, 7.0])
    return WorldState(utime, np.array([0, 0, 7]), np.array([REAL, TWIN, VIRTUAL]), x, *np.zeros((6, 3)))


# What can be chosen


def test_every_number_of_every_stream_can_be_chosen() -> None:
    table = RobotTable()
    table.take_world(NOW, world(NOW))
    channels = [stream.channel(3 if stream.per_robot else None) for stream in STREAMS]
    offered = sources(channels, table.present(NOW), {"RANGE_SCAN_3": 2})
    names = {str(name) for source in offered for name in source.signals()}
    assert {"MOTOR_FEEDBACK_3.psi_left", "GYRO_3.yaw_rate", "ESTOP.engaged", "RANGE_SCAN_3.ranges[1]"} <= names
    assert {"WORLD_STATE.x[robot 7]", "WORLD_STATE.theta[twin 0]"} <= names
    assert not {"PARAMETERS_3.yaml", "CAMERA_IMAGE.jpeg", "GYRO_3.utime", "RANGE_SCAN_3.ranges[2]"} & names
    streams = {source.channel for source in offered}
    assert streams == set(channels), "no stream is left out"
    assert CAMERA_IMAGE.name in streams


def test_channels_are_in_the_order_of_robots() -> None:
    offered = sources(["POSE_10", "POSE_2", "GYRO_3", "STRANGE"], RobotTable().present(0), {})
    assert [str(source) for source in offered] == ["GYRO_3", "POSE_2", "POSE_10"]
    assert str(Source("WORLD_STATE", "twin", 4)) == "WORLD_STATE twin 4"


# Live


def test_live_a_signal_is_seen_from_when_it_was_chosen_until_the_window_has_passed() -> None:
    curves = LiveCurves()
    curves.take(NOW - SECOND, "GYRO_0", reading(NOW - SECOND, 9.0))
    curves.want([RATE])
    for k in range(20):
        curves.take(NOW + SECOND, "GYRO_0", reading(NOW + k * SECOND // 20, float(k)))  # they arrive in a bunch
    curves.take(NOW, "GYRO_0", b"nonsense")
    curves.take(NOW, "POSE_0", b"not wanted")
    curve = curves.curve(RATE, 10.0, NOW + SECOND)
    assert curve.values.tolist() == list(range(20))
    assert np.diff(curve.seconds) == pytest.approx(0.05), "the times are those of the messages"
    assert (curve.begin, curve.end, curve.cursor, curve.note) == (-10.0, 0.0, None, "")
    later = curves.curve(RATE, 10.0, NOW + 30 * SECOND)
    assert (len(later.values), later.note) == (0, "no message on GYRO_0 in this window")


def test_a_sender_whose_clock_is_wrong_is_drawn_when_it_was_heard() -> None:
    curves = LiveCurves()
    curves.want([RATE])
    curves.take(NOW, "GYRO_0", reading(NOW - 3600 * SECOND, 1.0))
    assert curves.curve(RATE, 10.0, NOW).seconds.tolist() == [0.0]


def test_live_memory_is_bounded_in_values_and_in_signals(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cmr.view.curves.MOST_LIVE", 50)
    curves = LiveCurves()
    curves.want([RATE])
    for k in range(120):
        curves.take(NOW + k, "GYRO_0", reading(NOW + k, float(k)))
    assert curves.curve(RATE, 10.0, NOW + 120).values.tolist() == list(range(70, 120))
    many = [FieldName(f"GYRO_{k}", "yaw_rate") for k in range(MOST_SIGNALS + 1)]
    curves.want(many)
    assert "keeps" in curves.curve(many[-1], 10.0, NOW).note
    curves.want([])
    curves.want([RATE])
    assert len(curves.curve(RATE, 10.0, NOW + 120).values) == 0, "what nobody looks at is forgotten"


def test_of_a_world_in_parts_those_count_that_speak_of_the_robot() -> None:
    curves, x = LiveCurves(), [FieldName("WORLD_STATE", "x", 0, "twin"), FieldName("WORLD_STATE", "x", 8, "robot")]
    curves.want(x)
    curves.take(NOW, "WORLD_STATE", world(NOW).encode())
    assert [curves.curve(name, 10.0, NOW).values.tolist() for name in x] == [[1.0], []]


# Of a log


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """100 s of a gyro at 50 Hz, which reads 0.1 rad/s, and once 5 rad/s."""
    path = tmp_path_factory.mktemp("logs") / "gyro.lcm"
    moments = [NOW + k * SECOND // 50 for k in range(5000)]
    events = [Event(k, utime, "GYRO_0", reading(utime, 5.0 if k == 3333 else 0.1)) for k, utime in enumerate(moments)]
    path.write_bytes(b"".join(map(event_bytes, events)))
    return path


def read(path: Path, *names: FieldName) -> LogCurves:
    index = LogIndex(EventReader(path))
    while not index.build(1.0):
        pass
    curves = LogCurves(index)
    curves.want(names)
    while curves.pending:
        curves.read(0.1)
    return curves


def test_a_spike_of_one_message_is_seen_in_a_long_log_that_is_kept_in_little_memory(
    log: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("cmr.view.curves.MOST_OF_LOG", 300)
    monkeypatch.setattr("cmr.recordings.thinning.ROWS_AT_ONCE", 500)
    curve = read(log, RATE).curve(RATE, 0.0, NOW + 50 * SECOND)
    assert len(curve.values) <= 300
    assert curve.values.max() == 5.0
    assert curve.seconds[curve.values.argmax()] == pytest.approx(66.66)
    assert (curve.begin, curve.end, curve.cursor) == pytest.approx((0.0, 99.98, 50.0))


def test_a_part_of_a_log_has_all_its_values_and_follows_the_playback_in_whole_windows(log: Path) -> None:
    curves = read(log, RATE)
    for cursor in (60.0, 69.9):
        curve = curves.curve(RATE, 10.0, NOW + int(cursor * SECOND))
        assert (curve.begin, curve.end, curve.cursor) == pytest.approx((60.0, 70.0, cursor))
        assert len(curve.values) == 1 + 501 + 1, "one more on each side"
    assert curves.windows[WHOLE] == 0.0


def test_a_signal_that_is_chosen_while_the_log_is_read_is_read_afterwards(log: Path) -> None:
    curves, other = LogCurves(LogIndex(EventReader(log))), FieldName("GYRO_0", "valid")
    curves.want([RATE])
    curves.read(1e-6)
    assert curves.curve(RATE, 0.0, NOW).note.startswith("reading the log")
    curves.want([RATE, other, FieldName("GYRO_1", "yaw_rate")])
    while curves.pending:
        curves.read(0.1)
    counts = [len(curves.curve(name, 0.0, NOW).values) for name in (RATE, other)]
    assert counts == [5000, 5000]
    assert curves.curve(FieldName("GYRO_1", "yaw_rate"), 0.0, NOW).note == "no message on GYRO_1 in this log"


# As it is drawn


def drawn(seconds: Any, values: Any, cursor: float | None = None) -> tuple[Any, ...]:
    return columns(Curve(np.array(seconds, float), np.array(values, float), 0.0, 10.0, cursor), -1.0, 1.0)


def test_spikes_survive_the_drawing_and_nothing_in_it_is_no_number() -> None:
    values = np.zeros(50_000)
    values[12_345], values[23_456] = 1.0, np.inf
    seconds, curve, gaps, now = drawn(np.linspace(0.0, 10.0, 50_000), values, 5.0)
    assert len(seconds) < 4 * PIXELS
    assert curve.max() == 1.0
    assert all(np.isfinite(column).all() for column in (seconds, curve, gaps, now))
    assert (np.diff(seconds) >= 0.0).all()


def test_the_cursor_is_where_the_playback_is_and_does_not_change_the_curve() -> None:
    seconds, curve, _, now = drawn([0.0, 1.0, 2.0, 10.0], [0.0, 1.0, 0.0, 0.0], 1.5)
    assert seconds[now > 0.0].min() == seconds[now < 0.0].max() == 1.5
    assert curve[seconds == 1.5].tolist() == [0.5, 0.5]
    assert abs(now).min() > 1.0, "but for its rise it is out of sight"


def test_silences_are_grey_from_the_last_value_to_the_next_and_at_the_ends() -> None:
    times = [*np.arange(2.0, 4.0, 0.1), *np.arange(6.0, 8.0, 0.1)]
    seconds, _, gaps, _ = drawn(times, np.zeros(len(times)))
    edges = seconds[1:][np.diff(gaps) != 0.0]
    assert edges == pytest.approx([0.0, 2.0, 3.9, 6.0, 7.9, 10.0])


def test_the_value_at_the_cursor_stands_above_the_curve_with_its_unit() -> None:
    curve = Curve(np.arange(3.0), np.array([0.1, 0.2, 0.3]), 0.0, 2.0, 1.5, "reading <the log>")
    told = title(RATE, "rad/s", curve)
    assert "GYRO_0.yaw_rate" in told
    assert "0.2 rad/s" in told
    assert "&lt;the log&gt;" in told
