"""cmr-log tells what is in logs and how healthy they are, cuts and merges them, and ends at no damage."""

import json
import random
import re
import sys
from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cmr.cli.errors import CommandError
from cmr.distribution import how_to_install
from cmr.recordings.events import Event, EventReader, event_bytes
from cmr_tools.logs.main import main
from tests.support.documented_keys import documented
from tests.support.small_log import START, gyro_readings, small_log

WHOLE = small_log()
FORMATS = {"csv": "tables", "parquet": "tables", "mcap": "run.mcap"}


def write(path: Path, events: list[Event]) -> Path:
    path.write_bytes(b"".join(map(event_bytes, events)))
    return path


def numbered(events: list[Event]) -> list[Event]:
    return [event._replace(number=number) for number, event in enumerate(events)]


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return write(tmp_path / "run.lcm", WHOLE)


def info(log: Path, capsys: pytest.CaptureFixture[str]) -> str:
    assert main(["info", str(log)]) == 0
    return capsys.readouterr().out


def row(said: str, channel: str) -> list[str]:
    """Type, messages, rate, size, gaps, longest, jitter, errors and late of a channel."""
    [line] = [line for line in said.splitlines() if line.startswith(f"{channel} ")]
    return line.split()[1:]


# info


def test_info_tells_start_duration_and_what_is_on_each_channel(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = info(log, capsys)
    assert f"{log}: 105 events on 22 channels" in said
    assert "1.040 s from 2023-11-14 22:13:20 UTC on" in said
    assert "no damage" in said
    assert row(said, "GYRO_4") == ["gyro_t", "84", "100.00", "3.1", "0", "0.010", "0.00", "0", "0"]
    assert row(said, "ESTOP") == ["estop_t", "1", "-", "0.0", "-", "-", "-", "0", "0"]


def test_info_finds_gaps_and_jitter(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shake = random.Random(1)
    readings = gyro_readings(0, 6000)
    shaken = [event._replace(utime=event.utime + round(shake.gauss(0.0, 1000.0))) for event in readings]
    said = info(write(tmp_path / "gaps.lcm", shaken[:2000] + shaken[2120:5000] + shaken[5300:]), capsys)
    _, messages, _, _, gaps, longest, jitter, _, late = row(said, "GYRO_4")
    assert (messages, gaps, late) == ("5580", "2", "0")
    assert float(longest) == pytest.approx(3.01, abs=0.01)
    assert float(jitter) == pytest.approx(2.0**0.5, rel=0.05)
    told = re.search(r"GYRO_4: 2 gaps, the longest of 3\.\d+ s, (49\.\d+) s after the log's start\.", said)
    assert told is not None
    assert float(told[1]) == pytest.approx(49.99, abs=0.01)


def test_info_counts_what_does_not_decode_and_what_is_late(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    events = gyro_readings(0, 50)
    events[10], events[11] = events[11], events[10]
    events[20] = events[20]._replace(data=events[20].data[:-1])
    events[30] = events[30]._replace(data=bytes(40))
    events[40:42] = gyro_readings(40, 2, "GYRO_5")
    said = info(write(tmp_path / "run.lcm", [*events, Event(0, START, "NOBODYS", b"")]), capsys)
    assert row(said, "GYRO_4")[-2:] == ["2", "1"]
    assert row(said, "GYRO_5")[-2:] == ["2", "0"]
    assert row(said, "NOBODYS")[:2] == ["?", "1"]
    assert {"GYRO_4: 1 x corrupt.", "GYRO_4: 1 x foreign.", "GYRO_5: 2 x wrong_robot."} <= set(said.splitlines())


def test_parts_of_the_world_sent_together_are_no_gaps(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    [part] = [event for event in WHOLE if event.channel == "WORLD_STATE"]
    times = [START + 50_000 * frame + 30 * k for frame in range(40) for k in range(5) if frame not in (20, 21, 22)]
    said = info(write(tmp_path / "run.lcm", [part._replace(utime=utime) for utime in times]), capsys)
    assert row(said, "WORLD_STATE")[4:7] == ["1", "0.200", "-"]


def test_info_tells_the_size_of_the_damage(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    content = log.read_bytes()
    log.write_bytes(b"garbage" + content + event_bytes(WHOLE[0])[:-3])
    said = info(log, capsys)
    damaged = 7 + len(event_bytes(WHOLE[0])) - 3
    assert f"{damaged} of {log.stat().st_size} bytes, in 2 places, are damaged; the intact events are used." in said
    assert f"{log}: 105 events" in said


def test_info_says_when_a_file_is_no_log(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "picture.png").write_bytes(random.Random(1).randbytes(10_000))
    assert "no intact event in 10000 bytes. Is it an event log" in info(tmp_path / "picture.png", capsys)


# cut and merge


def test_a_cut_holds_the_events_of_its_time_and_channels_as_they_were(log: Path, tmp_path: Path) -> None:
    out = tmp_path / "piece.lcm"
    assert main(["cut", str(log), "--start", "0.2", "--stop", "0.5", "--channel", "GYRO_*", "--out", str(out)]) == 0
    expected = [event for event in WHOLE if 200_000 <= event.utime - START < 500_000 and event.channel == "GYRO_4"]
    assert list(EventReader(out)) == numbered(expected)
    assert main(["cut", str(log), "--channel", "GYRO_*", "--without", "GYRO_4", "--out", str(out)]) == 0
    assert [event.channel for event in EventReader(out)] == ["GYRO_3"]


times = st.lists(st.integers(0, 10**6), max_size=30).map(sorted)


@given(times, st.floats(0.0, 1.0))
@settings(max_examples=15, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_pieces_merged_are_the_log_again(tmp_path: Path, moments: list[int], place: float) -> None:
    events = [Event(n, START + t, f"GYRO_{n % 3}", bytes([n])) for n, t in enumerate([0, *moments, 10**6])]
    log, out = write(tmp_path / "run.lcm", events), tmp_path / "again.lcm"
    second = f"{min(max(place, 1e-6), 0.999):.6f}"
    pieces = [str(tmp_path / "first.lcm"), str(tmp_path / "second.lcm")]
    main(["cut", str(log), "--to", second, "--out", pieces[0]])
    main(["cut", str(log), "--from", second, "--out", pieces[1]])
    main(["merge", *pieces, "--out", str(out)])
    assert out.read_bytes() == log.read_bytes()


@given(times, times)
@settings(max_examples=15, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_merge_is_in_order_of_time_and_loses_nothing(tmp_path: Path, first: list[int], second: list[int]) -> None:
    logs = [
        write(tmp_path / f"{name}.lcm", [Event(n, t, name, bytes([n])) for n, t in enumerate([0, *moments])])
        for name, moments in (("A", first), ("B", second))
    ]
    out = tmp_path / "both.lcm"
    main(["merge", *map(str, logs), "--out", str(out)])
    merged = list(EventReader(out))
    parts = [event for log in logs for event in EventReader(log)]
    assert merged == numbered(sorted(parts, key=lambda event: event.utime))


# damage and errors


@pytest.mark.slow
@given(st.data())
@settings(max_examples=8, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_no_damage_ends_a_tool(tmp_path: Path, data: st.DataObject) -> None:
    content = bytearray(b"".join(map(event_bytes, WHOLE[:20])))
    for _ in range(data.draw(st.integers(1, 4))):
        first = data.draw(st.integers(0, len(content)))
        last = min(first + data.draw(st.sampled_from([0, 1, 40, 500])), len(content))
        damages = st.sampled_from([b"", bytes(last - first), b"\xff" * 9])
        content[first:last] = data.draw(damages | st.binary(max_size=30))
    log = tmp_path / "damaged.lcm"
    log.write_bytes(content)
    assert main(["info", str(log)]) == 0
    for name, out in {**FORMATS, "cut": "piece.lcm"}.items():
        with suppress(CommandError):  # where nothing is left
            assert main([name, str(log), "--out", str(tmp_path / out)]) == 0


@pytest.mark.parametrize("name", [*FORMATS, "cut", "merge"])
def test_a_log_without_events_is_one_line_and_nothing_is_written(name: str, tmp_path: Path) -> None:
    log, out = tmp_path / "empty.lcm", tmp_path / "out"
    log.touch()
    with pytest.raises(CommandError) as error:
        main([name, str(log), "--out", str(out)])
    assert "\n" not in str(error.value)
    assert not out.exists() or not any(out.iterdir())


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["info", "none.lcm"], "none.lcm: No such file or directory"),
        (["info", "."], ". is no file"),
        (["cut", "run.lcm", "--out", "run.lcm"], "run.lcm is the log itself; name another file with --out"),
        (["merge", "run.lcm", "--out", "none/x.lcm"], "none is no folder"),
        (["cut", "run.lcm", "--out", "."], ". is a folder; name a file"),
        (["cut", "run.lcm", "--from", "2", "--to", "1", "--out", "x.lcm"], "--stop 1 is no later than --start 2"),
        (["cut", "run.lcm", "--channel", "NONE", "--out", "x.lcm"], "run.lcm: no event lies there"),
        (["csv", "run.lcm", "--out", "run.lcm"], "run.lcm: File exists"),
    ],
)
def test_what_cannot_be_done_is_said(
    arguments: list[str], said: str, log: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(log.parent)
    with pytest.raises(CommandError, match=re.escape(said)):
        main(arguments)
    assert sorted(path.name for path in log.parent.iterdir()) == ["run.lcm"]


@pytest.mark.parametrize(("name", "module", "extra"), [("mcap", "mcap", "log"), ("parquet", "pyarrow", "sweep")])
def test_a_missing_library_is_told_with_what_to_install(
    name: str, module: str, extra: str, log: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for part in (module, f"{module}.writer", f"{module}.parquet"):
        monkeypatch.setitem(sys.modules, part, None)
    with pytest.raises(CommandError, match=re.escape(f"To install it: {how_to_install(extra)}")):
        main([name, str(log), "--out", str(log.parent / "out")])


def test_programs_read_as_json_what_persons_read_in_tables(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", "--json", str(log)]) == 0
    [info] = json.loads(capsys.readouterr().out)["logs"]
    of_log, of_channel, of_files = documented("cmr log")
    assert set(info) == of_log
    assert all(set(channel) == of_channel for channel in info["channels"].values())
    assert (info["events"], info["path"]) == (len(WHOLE), str(log))
    assert info["channels"]["GYRO_3"]["type"] == "gyro_t"
    assert main(["--json", "csv", "--log", str(log), "--out", str(log.parent / "tables")]) == 0
    written = json.loads(capsys.readouterr().out)
    assert set(written) <= of_files
    assert {Path(file["path"]).name: file["rows"] for file in written["written"]}["POSE_3.csv"] == 1


@pytest.mark.parametrize("logs", [[], ["a.lcm", "--log", "b.lcm"]])
def test_a_command_for_one_log_takes_one(logs: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["cut", *logs, "--out", "x.lcm"])
    assert "cmr-log cut: error: name one event log" in capsys.readouterr().err
