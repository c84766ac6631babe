"""What cmr-plot draws is what the logs hold, labelled with units; and what it cannot draw it says."""

import math
from pathlib import Path

import lcm
import numpy as np
import pytest

from cmr.bus.fields import FieldName, unit_of
from cmr.bus.messages import make
from cmr.cli.errors import CommandError
from cmr.msg import motor_feedback_t, pose_xyt_t, waypoints_t, world_state_t
from cmr.recordings.events import Event, EventReader
from cmr.recordings.thinning import Rows, broken_at_gaps, thinned, thinned_path
from cmr_tools.plot import main as plot
from cmr_tools.plot.fields import Gathered, Values, against, near_names, parse_field
from cmr_tools.plot.figure import Curve, Panel, figure_of

BEGIN = 1_700_000_000_000_000  # us
LATE = 20_000  # us from measurement to logging
RADIUS = 2.0  # m


def write_log(path: Path, robot_ids: tuple[int, ...] = (0,)) -> Path:
    """Write 4 s of circles, poses at 20 Hz and wheels at 50 Hz, and one message of waypoints."""
    log = lcm.EventLog(str(path), "w", overwrite=True)
    log.write_event(BEGIN, "CAMERA", b"picture")
    for step in range(400):
        utime = BEGIN + 10_000 * step
        for robot_id in robot_ids:
            angle = step / 100.0
            place = {"x": RADIUS * math.cos(angle), "y": RADIUS * math.sin(angle), "theta": angle}
            if step % 5 == 0:
                message = make(pose_xyt_t, utime=utime, robot_id=robot_id, **place)
                log.write_event(utime + LATE, f"POSE_{robot_id}", message.encode())
            if step % 2 == 0:
                fields = dict.fromkeys(motor_feedback_t.__slots__, 0) | {"utime": utime, "psi_left": angle}
                log.write_event(utime + LATE, f"MOTOR_FEEDBACK_{robot_id}", make(motor_feedback_t, **fields).encode())
    points = make(waypoints_t, utime=BEGIN, robot_id=0, x=[1.0, 5.0], y=[2.0, 6.0])
    log.write_event(BEGIN + LATE, "WAYPOINTS_0", points.encode())
    log.close()
    return path


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_log(tmp_path_factory.mktemp("logs") / "run.lcm")


def gather(log: Path, *fields: str) -> Gathered:
    return Gathered([parse_field(field) for field in fields], EventReader(log))


# Which field


def test_fields_are_written_as_channel_and_field_and_number() -> None:
    assert parse_field("POSE_0.x") == FieldName("POSE_0", "x")
    assert parse_field("WORLD_STATE.psi_left[3]") == FieldName("WORLD_STATE", "psi_left", 3)
    assert [str(parse_field(text)) for text in ("POSE_0.x", "WORLD_STATE.x[3]")] == ["POSE_0.x", "WORLD_STATE.x[3]"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("POSE_0", "is neither a file nor a field"),
        ("POSE_0.z", r"has no such field: z\. It has POSE_0\.y, POSE_0\.x, .*POSE_0\.theta"),
        ("MOTOR_FEEDBACK_0.psi_lef", r"It has MOTOR_FEEDBACK_0\.psi_left, "),
        ("PROCESS_STATUS.message", "has text there"),
        ("WAYPOINTS_0.x", r"name one, such as 'WAYPOINTS_0\.x\[0\]'"),
        ("POSE_0.x[0]", "is one number"),
        ("WORLD_STATE.x", r"such as 'WORLD_STATE\.x\[robot 0\]'"),
        ("WAYPOINTS_0.x[robot 3]", "by number, not by robot"),
    ],
)
def test_a_wrong_field_is_told_with_those_that_there_are(text: str, said: str) -> None:
    with pytest.raises(CommandError, match=said):
        parse_field(text)


def test_units_are_those_of_the_message_types() -> None:
    fields = ("POSE_0.x", "POSE_0.theta", "MOTOR_FEEDBACK_0.psi_left", "MOTOR_FEEDBACK_0.temperature", "GYRO_0.valid")
    assert [unit_of(parse_field(text)) for text in fields] == ["m", "rad", "rad/s", "deg C", ""]


def test_near_names_are_of_the_channels_of_the_log() -> None:
    assert near_names("POSE_1.x", ["POSE_0", "CAMERA", "WAYPOINTS_0"])[0] == "POSE_0.x"


# Its values


def test_values_stand_at_the_times_at_which_they_were_measured(log: Path) -> None:
    seconds, values = gather(log, "POSE_0.theta").values(FieldName("POSE_0", "theta"))
    assert len(seconds) == 80
    assert seconds == pytest.approx(np.arange(80) * 0.05)
    assert values == pytest.approx(seconds)


def test_elements_of_arrays_are_found_and_missing_ones_are_no_numbers(log: Path) -> None:
    gathered = gather(log, "WAYPOINTS_0.y[1]", "WAYPOINTS_0.y[2]")
    assert gathered.values(FieldName("WAYPOINTS_0", "y", 1)).values.tolist() == [6.0]
    assert np.isnan(gathered.values(FieldName("WAYPOINTS_0", "y", 2)).values).tolist() == [True]
    assert "CAMERA" in gathered.channels


def test_a_robot_is_found_wherever_it_stands_in_the_world_and_told_from_its_twin() -> None:
    fields = ("robot_id", "origin", "x", "y", "theta", "psi_left", "psi_right", "domega_left", "domega_right")
    worlds = [[(7, 1, 1.0)], [(0, 0, 2.0), (7, 1, 3.0), (0, 2, 4.0)], [(0, 0, 5.0)], [(0, 2, 6.0), (7, 1, 7.0)]]
    events = []
    for k, robots in enumerate(worlds):
        columns = [list(column) for column in zip(*robots, strict=True)]
        columns += [[0.0] * len(robots)] * 6
        message = make(world_state_t, utime=BEGIN + k * 1_000_000, **dict(zip(fields, columns, strict=True)))
        events.append(Event(k, BEGIN + k * 1_000_000, "WORLD_STATE", message.encode()))
    names = [parse_field(f"WORLD_STATE.x[{whose}]") for whose in ("robot 7", "robot 0", "twin0", "robot 9")]
    gathered = Gathered(names, events)
    found = [[part.tolist() for part in gathered.values(name)] for name in names]
    assert found == [[[0, 1, 3], [1, 3, 7]], [[1, 2], [2, 5]], [[1, 3], [4, 6]], [[], []]]
    assert str(names[2]) == "WORLD_STATE.x[twin 0]"


def test_one_field_against_another_of_other_times_is_interpolated_and_never_extrapolated() -> None:
    horizontal = Values(np.array([0.0, 1.0, 2.0, 9.0]), np.array([5.0, 6.0, 7.0, 8.0]))
    vertical = Values(np.array([0.5, 2.5]), np.array([10.0, 14.0]))
    x, y = against(horizontal, vertical)
    assert x.tolist() == [5.0, 6.0, 7.0, 8.0]
    assert y == pytest.approx([np.nan, 11.0, 13.0, np.nan], nan_ok=True)


def test_a_silence_breaks_the_line() -> None:
    seconds, values = broken_at_gaps(np.array([0.0, 0.1, 0.2, 5.0, 5.1]), np.arange(5.0))
    assert values == pytest.approx([0.0, 1.0, 2.0, np.nan, 3.0, 4.0], nan_ok=True)
    assert seconds.tolist() == [0.0, 0.1, 0.2, 5.0, 5.0, 5.1]


# The figure


def panels_of(logs: list[Path], *fields: str) -> list[Panel]:
    asked = [plot._asked(text) for text in fields]
    names = {name for one in asked for name in one.names}
    return plot._panels(asked, logs, [Gathered(names, EventReader(path)) for path in logs])


def test_fields_of_one_unit_share_a_panel_and_axes_have_their_units(log: Path) -> None:
    places, angle, path = panels_of([log], "POSE_0.x", "POSE_0.theta", "POSE_0.y", "POSE_0.x:POSE_0.y")
    assert [curve.label for curve in places.curves] == ["POSE_0.x", "POSE_0.y"]
    assert (places.x_label, places.y_label) == ("time since the log began [s]", "x, y [m]")
    assert angle.y_label == "POSE_0.theta [rad]"
    assert (path.x_label, path.y_label, path.same_scale) == ("POSE_0.x [m]", "POSE_0.y [m]", True)
    [circle] = path.curves
    assert np.hypot(circle.x, circle.y) == pytest.approx(np.full(80, RADIUS))


def test_several_logs_lie_over_each_other_and_are_told_apart(log: Path, tmp_path: Path) -> None:
    other = write_log(tmp_path / "other.lcm")
    [panel] = panels_of([log, other], "POSE_0.x")
    assert [curve.label for curve in panel.curves] == ["POSE_0.x, run.lcm", "POSE_0.x, other.lcm"]
    assert plot._names([Path("a/run.lcm"), Path("b/run.lcm")]) == ["a/run.lcm", "b/run.lcm"]
    figure = figure_of([panel], "both", 2)
    first, second = figure.axes[0].get_lines()
    assert first.get_color() != second.get_color()


def test_panels_over_time_share_their_time_axis() -> None:
    curve = Curve("a", np.arange(3.0), np.arange(3.0), 0, 0)
    over_time = Panel("t", "y", [curve], over_time=True)
    figure = figure_of([over_time, over_time._replace(over_time=False), over_time], "title", 1)
    first, path, last = figure.axes
    first.set_xlim(0.0, 77.0)
    assert last.get_xlim() == (0.0, 77.0)
    assert path.get_xlim() != (0.0, 77.0)


# The command


@pytest.mark.parametrize(("name", "begin"), [("a.png", b"\x89PNG"), ("a.SVG", b"<?xml"), ("a.pdf", b"%PDF")])
def test_a_file_of_the_kind_that_its_name_says_is_written(log: Path, tmp_path: Path, name: str, begin: bytes) -> None:
    assert plot.main([str(log), "POSE_0.x:POSE_0.y", "--out", str(tmp_path / name)]) == 0
    assert (tmp_path / name).read_bytes().startswith(begin)


def test_what_no_log_has_is_an_error_and_what_one_lacks_is_said(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other, out = write_log(tmp_path / "other.lcm", robot_ids=(1,)), tmp_path / "a.png"
    with pytest.raises(CommandError, match=r"has no POSE_2\.x\. Near names: POSE_0\.x"):
        plot.main([str(log), "POSE_2.x", "--out", str(out)])
    assert not out.exists()
    assert plot.main([str(log), str(other), "POSE_0.x", "--out", str(out)]) == 0
    assert f"{other} has no POSE_0.x." in capsys.readouterr().err


@pytest.mark.parametrize(
    "arguments", [["run.lcm"], ["POSE_0.x"], ["run.lcm", "POSE_0.x", "--out", "a.bmp"]], ids=["field", "log", "kind"]
)
def test_what_is_missing_or_of_no_known_kind_is_wrong_usage(arguments: list[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        plot.main(arguments)


def test_a_log_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(CommandError, match=r"none\.lcm: No such file"):
        plot.main([str(tmp_path / "none.lcm"), "POSE_0.x", "--out", str(tmp_path / "a.png")])


def test_a_picture_of_a_long_log_has_few_points_and_loses_no_peak_and_no_gap() -> None:
    seconds = np.arange(100_000) / 100.0
    values = np.sin(seconds)
    values[41_234], values[70_001] = 9.0, -9.0
    values[50_000:50_500] = np.nan
    kept_seconds, kept = thinned(seconds, values)
    assert len(kept) < 7000
    assert (kept[0], np.nanmax(kept), np.nanmin(kept)) == (0.0, 9.0, -9.0)
    assert kept_seconds[np.isnan(kept)][[0, -1]].tolist() == [500.0, 504.99]
    assert (np.diff(kept_seconds) > 0.0).all()
    assert (kept_seconds[0], kept_seconds[-1]) == (0.0, 999.99)
    assert thinned(seconds[:9000], values[:9000])[1].tolist() == values[:9000].tolist()


def spiky(count: int) -> tuple[np.ndarray, np.ndarray]:
    """A sine at 100 Hz with one sample that is far off."""
    seconds = np.arange(count) / 100.0
    values = np.sin(seconds)
    values[count * 2 // 3] = 9.0
    return seconds, values


def test_one_value_that_is_far_off_survives_however_many_there_are() -> None:
    rows = Rows(3, most=1000)
    count = 120_000
    _, values = spiky(count)
    for k in range(count):
        rows.add(BEGIN + 10_000 * k, (values[k], -values[count - 1 - k], np.nan if k % 2 else 1.0))
    times, kept = rows.all()
    assert 200 < len(times) <= 1000
    assert np.isnan(kept[:, 2]).any()
    assert (np.diff(times) > 0).all()
    assert np.diff(times).max() < 2 * 10_000 * count / 100, "evenly thinned"
    for column, extreme, place in ((0, 9.0, count * 2 // 3), (1, -9.0, count - 1 - count * 2 // 3)):
        [row] = np.flatnonzero(kept[:, column] == extreme)
        assert times[row] == BEGIN + 10_000 * place
    assert np.abs(np.sin((times - BEGIN) / 1e6) - kept[:, 0])[kept[:, 0] != 9.0].max() < 1e-6, "rows stay together"


def test_few_rows_are_all_kept() -> None:
    rows = Rows(2, most=1000)
    for k in range(1000):
        rows.add(k, (float(k), -float(k)))
    times, values = rows.all()
    assert times.tolist() == values[:, 0].tolist() == (-values[:, 1]).tolist() == list(range(1000))
    assert Rows(2, most=9).all()[1].shape == (0, 2)


def test_who_looks_closely_sees_every_value_and_who_looks_from_afar_still_sees_the_peak() -> None:
    seconds, values = spiky(300_000)
    figure = figure_of([Panel("t", "y", [Curve("a", seconds, values, 0, 0)], over_time=True)], "title", 1)
    [axes] = figure.axes
    [line] = axes.get_lines()
    whole_view, limits = axes.get_xlim(), axes.get_ylim()
    assert len(np.asarray(line.get_xdata())) < 7000
    assert np.max(np.asarray(line.get_ydata())) == 9.0
    axes.set_xlim(100.0, 110.0)
    assert np.asarray(line.get_ydata()).tolist() == values[9999:11_002].tolist()
    assert axes.get_ylim() == limits
    axes.set_xlim(*whole_view)
    assert np.max(np.asarray(line.get_ydata())) == 9.0
    axes.set_xlim(-9.0, -8.0)
    assert len(np.asarray(line.get_xdata())) <= 1


def test_a_path_that_stays_in_place_has_few_points_and_keeps_its_excursions() -> None:
    x, y = np.zeros(100_000), np.zeros(100_000)
    x[50_000:50_600] = np.linspace(0.0, 1.0, 600)
    x[50_600:] = 1.0
    x[70_000], y[70_000], y[80_000] = 1.0, 3.0, np.nan
    kept_x, kept_y = thinned_path(x, y)
    assert len(kept_x) < 610
    assert (kept_x[0], kept_y[0], kept_x[-1], kept_y[-1]) == (0.0, 0.0, 1.0, 0.0)
    assert np.nanmax(kept_y) == 3.0
    assert np.isnan(kept_y).sum() == 1
    assert len(thinned_path(x[:0], y[:0])[0]) == 0
