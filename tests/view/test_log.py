"""cmr-view plays logs: any moment of one is shown as if all before had been played, and reading it takes no memory."""

import math
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from cmr.bus.messages import make
from cmr.bus.streams import PARAMETERS
from cmr.bus.world_state import WorldState
from cmr.msg import calibration_status_t, camera_image_t, estop_t, parameters_t, process_status_t, waypoints_t
from cmr.recordings.events import Event, EventReader, event_bytes
from cmr.view.data.log_index import LogIndex
from cmr.view.data.playback import Playback
from cmr.view.data.robots import REAL, TWIN, VIRTUAL
from cmr.view.replay_panel import ReplayPanel, labelled, seconds_of
from cmr.view.requests import JUMP, PAUSE, SPEED, Request
from cmr.view.showing import LogShowing
from tests.support.small_log import FIELDS, gyro_readings

BEGIN = 1_700_000_000_000_000  # us
SECOND = 1_000_000  # us
LENGTH = 100  # s


def drive() -> list[tuple[int, str, Any]]:
    """100 s of two robots, one with a twin, each in a part of its own at 20 Hz; two cameras; what happens meanwhile."""
    messages = [*driven(), *reported(), *pictured()]
    for utime, engaged in (
        (BEGIN + 20 * SECOND, True),
        (BEGIN + 20 * SECOND + 100_000, True),
        (BEGIN + 22 * SECOND, False),
    ):
        messages.append(
            (utime, "ESTOP", make(estop_t, utime=utime, engaged=engaged, source="a person", reason="smoke"))
        )
    path = make(waypoints_t, utime=BEGIN, robot_id=1, x=[0.0, 1.0], y=[0.0, 0.0])
    messages.append((BEGIN + SECOND, "WAYPOINTS_1", path))
    return sorted(messages, key=lambda entry: entry[0])


def driven() -> Iterator[tuple[int, str, Any]]:
    """Yield the states of all robots."""
    for k in range(20 * LENGTH):
        utime = BEGIN + k * SECOND // 20
        x, psi = 0.01 * k, 5.0 if 2 <= k / 20 < 38 or 42 <= k / 20 < 80 else 0.0
        apart = 0.3 if k / 20 < 40 else 0.01
        still = ([0.0] * 2,) * 2
        for part in (
            ([1, 1], [REAL, TWIN], [x, x + apart], [0.0] * 2, [0.0] * 2, [psi] * 2, [psi] * 2, *still),
            ([2], [VIRTUAL], [2 * x], *([0.0],) * 6),
        ):
            yield utime + part[0][0], "WORLD_STATE", WorldState(utime, *part)


def reported() -> Iterator[tuple[int, str, Any]]:
    """Yield what processes report each second, a calibration and versions of parameters."""
    for second in range(LENGTH):
        utime = BEGIN + second * SECOND + 30_000
        for number, process in enumerate(("cmr-sim", "cmr-driver", "cmr-diagnose")):
            told = "Its left motor is weaker." if process == "cmr-diagnose" and second >= 70 else "Watching."
            fields = {**FIELDS["PROCESS_STATUS"], "process": process, "message": told}
            yield utime + number, "PROCESS_STATUS", make(process_status_t, utime=utime, **fields)
        values = {**FIELDS["CALIBRATION_STATUS"], "state": 3 if second >= 40 else 1, "progress": min(second / 40, 1.0)}
        status = make(calibration_status_t, utime=utime, robot_id=1, **{**values, "message": "Found."})
        yield utime + 10, "CALIBRATION_STATUS_1", status
        version = second // 50 if second != 51 else 0  # of a process that hears of the new ones later
        values = {"sequence": version, "sha256": str(version) * 8, "yaml": ""}
        yield utime + 20, "PARAMETERS_1", make(parameters_t, utime=utime, robot_id=1, **values)


def pictured() -> Iterator[tuple[int, str, Any]]:
    """Yield the pictures of two cameras in turn."""
    for tenth in range(10 * LENGTH):
        camera = ("door", "window")[tenth % 2]
        utime = BEGIN + tenth * SECOND // 10 + 40_000
        image = make(camera_image_t, utime=utime, **{**FIELDS["CAMERA_IMAGE"], "camera": camera})
        yield utime, "CAMERA_IMAGE", image


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("logs") / "drive.lcm"
    events = [Event(k, utime, channel, message.encode()) for k, (utime, channel, message) in enumerate(drive())]
    path.write_bytes(b"".join(event_bytes(event) for event in events))
    return path


def playback_of(path: Path, *, indexed: bool = True) -> Playback:
    index = LogIndex(EventReader(path))
    while indexed and not index.build(1.0):
        pass
    return Playback(index)


def play_until(playback: Playback, seconds: float) -> None:
    while playback.position < BEGIN + seconds * SECOND:
        playback.play(0.25)


def seen(playback: Playback) -> tuple[Any, ...]:
    """What of a moment a person sees, but the trails."""
    state = playback.state
    poses = state.present().pose.tolist()
    told = sorted((name, heard.message.message) for (name, _, _), heard in state.processes.items())
    progress = [history[-1].message.progress for history in state.calibrations.values()]
    waypoints = sorted(state.latest["WAYPOINTS"])
    pictures = {name: heard.message.utime for name, heard in state.cameras.items()}
    return poses, told, progress, waypoints, state.estop.engaged, pictures


def reach(playback: Playback) -> list[float]:
    """From where to where the trails of the last 10 s go. [m along x]"""
    x = playback.state.trails.shown(playback.position, 10.0).ends[..., 0]
    return [float(x.min()), float(x.max())]


@pytest.mark.slow
@pytest.mark.parametrize("seconds", [1.5, 21.0, 45.2, 99.5])
def test_after_a_jump_all_is_as_if_it_had_been_played(log: Path, seconds: float) -> None:
    played, jumped = playback_of(log), playback_of(log)
    play_until(played, seconds)
    jumped.jump(BEGIN + 95 * SECOND)
    jumped.jump(played.position)
    assert seen(jumped) == seen(played)
    assert reach(jumped) == pytest.approx(reach(played), abs=0.3)
    for before_or_after in (0, 1):
        paths = [playback.state.drives.of(1)[before_or_after] for playback in (played, jumped)]
        assert [path is None for path in paths] == [seconds < (10.0, 50.0)[before_or_after]] * 2
        expected, found = ([path.rmse, *path.real[[0, -1], 0]] if path else [] for path in paths)
        assert found == pytest.approx(expected, abs=0.15)
    play_until(jumped, seconds + 0.3)
    play_until(played, seconds + 0.3)
    assert jumped.state.present().pose.tolist() == played.state.present().pose.tolist()


def test_a_jump_reads_little_of_a_long_log(log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    playback = playback_of(log)
    decoded: list[str] = []
    monkeypatch.setattr(playback.state.__class__, "handle", lambda _self, _utime, channel, _m: decoded.append(channel))
    playback.jump(BEGIN + 90 * SECOND)
    # Two parts each: of the minute before, four in a second lately, two before; three seconds at full rate for rates.
    assert decoded.count("WORLD_STATE") <= 2 * (12 * 4 + 48 * 2) + 2 * 3 * 20 + 10
    assert len(decoded) < 700


def test_slider_labels_do_not_lie_over_one_another_and_the_most_important_is_read() -> None:
    marks = [(1.0, "parameters"), (58.0, "parameters"), (59.0, "calibrated"), (60.0, "parameters"), (99.0, "stop")]
    assert labelled(marks, 100.0) == ((1.0, "parameters"), 58.0, (59.0, "calibrated"), 60.0, (99.0, "stop"))
    assert labelled([], 100.0) == ()


class FakeGui:
    """Keeps the inputs that are added to a page, by their label, and by whom they tell of it when typed into."""

    def __init__(self) -> None:
        self.made: dict[str, SimpleNamespace] = {}

    def add_folder(self, _label: str) -> Any:
        return nullcontext()

    def _add(self, label: str, *_values: Any, **_look: Any) -> SimpleNamespace:
        made = self.made[label] = SimpleNamespace(value="", max=0.0, label=label, options=(), remove=lambda: None)
        made.on_update = made.on_click = lambda call: setattr(made, "typed", call)
        return made

    add_slider = add_text = add_button = add_dropdown = _add

    def add_html(self, content: str) -> SimpleNamespace:
        return SimpleNamespace(content=content)

    def add_command(self, _label: str, **_keys: Any) -> SimpleNamespace:
        return SimpleNamespace(on_trigger=lambda call: call)


@pytest.mark.parametrize(
    ("text", "seconds"), [("90", 90.0), (" 1:30.5 ", 90.5), ("1:00:02", 3602.0), ("", None), ("1:", None), ("-3", None)]
)
def test_a_time_is_typed_in_seconds_or_minutes(text: str, seconds: float | None) -> None:
    assert seconds_of(text) == seconds


def test_a_time_is_gone_to_once_it_has_been_typed_and_nothing_is_written_over_it(
    log: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    playback = playback_of(log)
    clock = SimpleNamespace(now=100.0)
    monkeypatch.setattr("cmr.view.replay_panel.time.monotonic", lambda: clock.now)
    gui, asked = FakeGui(), []
    panel = ReplayPanel(playback)
    panel.add(gui, lambda *request: asked.append(request))  # type: ignore[arg-type]
    box = gui.made["go to"]
    for clock.now, box.value in ((100.0, "4"), (100.5, "45"), (100.6, "45.")):
        box.typed(SimpleNamespace(client_id=1))
        panel.show()
    assert asked == []
    clock.now = 102.0
    panel.show()
    panel.show()
    assert (asked, box.value) == ([(JUMP, playback.index.begin + 45 * SECOND)], "45.")


def test_the_calibrations_of_many_robots_are_read_again_in_part(tmp_path: Path) -> None:
    path = tmp_path / "many.lcm"
    with path.open("wb") as stream:
        for k in range(400 * 30):
            status = make(
                calibration_status_t, utime=BEGIN, robot_id=k % 30, **{**FIELDS["CALIBRATION_STATUS"], "progress": k}
            )
            event = Event(k, BEGIN + k * 10_000, f"CALIBRATION_STATUS_{k % 30}", status.encode())
            stream.write(event_bytes(event))
    playback = playback_of(path)
    playback.jump(playback.index.end)
    told = [[heard.message.progress for heard in history] for history in playback.state.calibrations.values()]
    assert all(35 <= len(progress) <= 50 and progress == sorted(progress) for progress in told)
    assert sorted(progress[-1] for progress in told) == list(range(400 * 30 - 30, 400 * 30))


def test_of_the_parameters_the_newest_version_counts_whoever_says_another(log: Path) -> None:
    for moment in (51.5, 52.5):
        playback = playback_of(log)
        playback.jump(BEGIN + int(moment * SECOND))
        newest = playback.state.newest(PARAMETERS, 1)
        assert newest is not None
        assert newest.sha256 == "1" * 8


def test_what_happened_has_its_marks(log: Path) -> None:
    marks = [(round((mark.utime - BEGIN) / SECOND), mark.word) for mark in playback_of(log).index.marks]
    expected = [(0, "parameters"), (20, "stop"), (22, "released"), (40, "calibrated"), (50, "parameters")]
    assert marks == [*expected, (70, "diagnosis")]


def test_a_log_can_be_jumped_in_before_it_is_read_and_shows_all_once_it_is(log: Path) -> None:
    playback, played = playback_of(log, indexed=False), playback_of(log)
    assert playback.index.end - playback.index.begin == pytest.approx(LENGTH * SECOND, abs=SECOND)
    playback.play(1.0)
    assert len(playback.state.present().robot_id) == 3
    play_until(played, 50.0)
    playback.jump(played.position)
    assert playback.index.indexed_until < BEGIN + 40 * SECOND
    assert playback.position == played.position
    assert playback.state.present().pose.tolist() == played.state.present().pose.tolist()
    playback.play(1.0)
    assert playback.is_guess
    assert playback.state.latest["WAYPOINTS"] == {}, "which were logged long before"
    while not playback.index.build(1.0):
        pass
    playback.paused = True
    playback.play(1.0)
    play_until(played, 51.0)
    assert playback.position == played.position
    assert not playback.is_guess
    assert seen(playback) == seen(played)


def test_a_jump_into_what_has_not_been_read_reads_little(log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cmr.view.data.log_index.CHUNK", 20_000)
    playback = playback_of(log, indexed=False)
    for seconds in (99.5, 33.3, 0.0, 66.6):
        moments = [
            moment for moment, _ in zip(playback.index.read(BEGIN + int(seconds * SECOND)), range(3), strict=False)
        ]
        assert all(0 <= moment[0] - BEGIN - seconds * SECOND < SECOND // 2 for moment in moments)
        assert len(moments) == 3


def test_speed_and_pause(log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cmr.view.data.playback.LONGEST_WORK", math.inf)  # else a busy computer leaves some for later
    playback = playback_of(log)
    playback.speed = 10.0
    playback.play(0.5)
    assert playback.position == playback.index.begin + 5 * SECOND
    playback.paused = True
    playback.play(0.5)
    assert playback.position == playback.index.begin + 5 * SECOND
    playback.paused, playback.speed = False, 50.0
    for _ in range(1000):
        playback.play(0.5)
    assert playback.at_end
    assert playback.position == playback.index.end


def test_wishes_of_a_visitor_move_the_log(log: Path) -> None:
    showing = LogShowing(log)
    while "read" in showing.head():
        showing.advance(0.0 if showing.state.now else 0.1)
        showing.advance(1.0)
    for request in (Request(PAUSE, 1), Request(JUMP, 1, BEGIN + 21 * SECOND), Request(SPEED, 1, 5.0)):
        showing.fulfil(request, BEGIN)
    assert "21.0 s" in showing.head()
    assert "In the log, the emergency stop is engaged by a person: smoke" in showing.head()
    assert not showing.orders.stopped, "what a log says stops nobody"
    showing.advance(1.0)
    assert "21.0 s" in showing.head()
    showing.fulfil(Request(JUMP, 1, BEGIN + LENGTH * SECOND), BEGIN)
    showing.fulfil(Request(PAUSE, 1), BEGIN)
    assert "· 0.0 s" in showing.head(), "at the end one plays again"


def test_the_clock_of_the_logger_may_be_set(tmp_path: Path) -> None:
    readings = gyro_readings(0, 400)
    shifts = [0] * 100 + [-7200 * SECOND] * 100 + [0] * 100 + [10**6 * SECOND] * 100
    moved = [event._replace(utime=event.utime + shift) for event, shift in zip(readings, shifts, strict=True)]
    path = tmp_path / "set.lcm"
    path.write_bytes(b"".join(event_bytes(event) for event in moved))
    playback = playback_of(path)
    moments = [utime for utime, _ in playback.index.read(0)]
    assert moments == sorted(moments)
    assert playback.index.end == moments[-1]
    playback.jump(playback.index.end)
    assert playback.state.latest["GYRO"][4].utime == moments[-1]


@pytest.mark.parametrize(
    ("size", "told"),
    [
        (0, "No intact event in 0 bytes."),
        (10, "No intact event in 10 bytes."),
        (100_000, " of 100000 bytes are damaged"),
    ],
)
def test_damaged_logs_are_played_and_the_damage_is_told(log: Path, tmp_path: Path, size: int, told: str) -> None:
    data = bytearray(log.read_bytes()[:size])
    data[40_000:60_000] = bytes(len(data[40_000:60_000]))
    path = tmp_path / "damaged.lcm"
    path.write_bytes(data)
    playback = playback_of(path)
    playback.jump(playback.index.end)
    playback.play(1.0)
    assert len(playback.state.present().robot_id) == (3 if size == 100_000 else 0)
    showing = LogShowing(path)
    showing.advance(10.0)
    assert told in showing.head()
