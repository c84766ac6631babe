"""Messages that cmr-log writes as CSV, Parquet and MCAP are read back whole by those formats' libraries."""

import base64
import csv
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet
import pytest
from mcap.reader import make_reader

from cmr.bus.fields import Field, fields_of
from cmr.bus.messages import decode
from cmr.bus.streams import STREAMS
from cmr.recordings.events import Event, event_bytes
from cmr_tools.importing.quantities import UNITS
from cmr_tools.logs import tables as log_tables
from cmr_tools.logs.main import main
from tests.support.small_log import START, gyro_readings, small_log

WHOLE = small_log()
MESSAGES = {event.channel: (event, decode(event.channel, event.data)) for event in WHOLE}
NAMES = sorted(MESSAGES)
WITHOUT_UNIT = {
    *("robot_id", "origin", "valid", "status", "n", "state", "progress", "pid", "loop_overruns", "engaged"),
    *("stored", "action", "claimant", "sender", "owner"),
    *("wanted", "once", "run", "name", "role", "command", "after", "files"),
    *("sha256", "yaml", "message", "process", "host", "parameters_sha256", "source", "reason"),
    *("camera", "width", "height", "jpeg"),
    *("explanations", "named", "excluded", "not_shown", "movement", "first", "second", "members"),
}
Row = dict[str, Any]


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("log") / "run.lcm"
    path.write_bytes(b"".join(map(event_bytes, [*WHOLE, Event(0, START, "NOBODYS", b"x")])))
    return path


def expected_rows(channel: str) -> list[Row]:
    """What a table is to hold of the last message on a channel: a row for each element of its arrays."""
    event, received = MESSAGES[channel]
    fields, message = fields_of(received.stream.message_type), received.message
    if not any(field.counted_by for field in fields):
        return [{"logged [us]": event.utime, **{field.column: told(getattr(message, field.name)) for field in fields}}]
    rows: list[Row] = []
    [counted_by] = {field.counted_by for field in fields if field.counted_by}
    count = int(getattr(message, counted_by))
    for index in range(max(count, 1)):
        row: Row = {"logged [us]": event.utime, "index": index if count else None}
        for field in fields:
            value = getattr(message, field.name)
            if field.counted_by is not None:
                value = single(field, value[index]) if count else None
            row[field.column] = value
        rows.append(row)
    return rows


def told(value: Any) -> Any:
    """Return a single value as tables and JSON tell it: bytes, a picture's, are text."""
    return base64.b64encode(value).decode() if isinstance(value, bytes) else value


def single(field: Field, value: Any) -> Any:
    return float(np.float32(value)) if field.wire_type == "float" else int(value)


def same(ours: Any, theirs: Any) -> bool:
    if isinstance(ours, float) and math.isnan(ours):
        return isinstance(theirs, float) and math.isnan(theirs)
    return bool(ours == theirs)


# units


def test_every_quantity_has_its_unit_and_it_is_the_one_of_imports() -> None:
    fields = [field for stream in STREAMS for field in fields_of(stream.message_type)]
    assert {field.name for field in fields if not field.unit} == WITHOUT_UNIT
    ours = {next(iter(units)) for units in UNITS.values()}
    others = {unit for units in UNITS.values() for unit in units} - ours
    assert ours <= {field.unit for field in fields}
    assert not others & {field.unit for field in fields}


def test_units_follow_the_comments() -> None:
    columns = {field.column for stream in STREAMS for field in fields_of(stream.message_type)}
    assert {"utime [us]", "yaw_rate [rad/s]", "psi_right [rad/s]", "left [duty]", "right [duty]"} <= columns
    assert {"k2_over_k3_std [rad/s^2]", "k1 [s/rad]", "theta [rad]", "ranges [m]", "temperature [deg C]"} <= columns


# CSV and Parquet


def test_csv_holds_every_message_in_full(log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["csv", str(log), "--out", str(tmp_path / "tables")]) == 0
    assert sorted(path.stem for path in (tmp_path / "tables").iterdir()) == NAMES
    for channel in NAMES:
        with (tmp_path / "tables" / f"{channel}.csv").open(encoding="utf-8", newline="") as stream:
            rows = list(csv.DictReader(stream))
        for ours, theirs in zip(expected := expected_rows(channel), rows[-len(expected) :], strict=True):
            assert list(ours) == list(theirs)
            for name, value in ours.items():
                text = theirs[name]
                assert text == "" if value is None else same(value, parsed(value, text)), (channel, name)
    said = capsys.readouterr().out
    assert "1 x a channel that is none of CMR's, left out: NOBODYS." in said
    assert "GYRO_4.csv: 84 rows" in said


def parsed(like: Any, text: str) -> Any:
    """Return the text as a value of the same kind; of single precision numbers, the nearest one."""
    if isinstance(like, bool):
        return text == "1"
    if isinstance(like, float):
        return float(text) if same(float(text), like) else float(np.float32(text))
    return type(like)(text)


def test_parquet_holds_every_message_in_full(log: Path, tmp_path: Path) -> None:
    assert main(["parquet", str(log), "--out", str(tmp_path)]) == 0
    for channel in NAMES:
        table = pyarrow.parquet.read_table(tmp_path / f"{channel}.parquet")
        expected = expected_rows(channel)
        for ours, theirs in zip(expected, table.to_pylist()[-len(expected) :], strict=True):
            assert list(ours) == list(theirs)
            assert all(same(value, theirs[name]) for name, value in ours.items()), channel


@pytest.mark.parametrize("name", ["MOST_OF_A_CHANNEL", "MOST_OF_ALL", "PARTS_OF_FIXED_SIZE"])
@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_tables_written_in_many_parts_are_the_same(
    name: str, suffix: str, log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for part in ("whole", "parts"):
        main([suffix, str(log), "--channel", "[GR]*", "--out", str(tmp_path / part)])
        monkeypatch.setattr(log_tables, name, 3 if name.startswith("PARTS") else 300)
    for whole in (tmp_path / "whole").iterdir():
        parts = tmp_path / "parts" / whole.name
        if suffix == "csv":
            assert parts.read_bytes() == whole.read_bytes()
        else:
            assert pyarrow.parquet.read_table(parts) == pyarrow.parquet.read_table(whole)


def test_a_message_that_does_not_decode_is_left_out_and_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    events = gyro_readings(0, 20)
    events[5] = events[5]._replace(data=events[5].data[:9])
    events[6] = events[6]._replace(utime=-1)
    (tmp_path / "run.lcm").write_bytes(b"".join(map(event_bytes, events)))
    assert main(["csv", str(tmp_path / "run.lcm"), "--out", str(tmp_path / "t")]) == 0
    said = capsys.readouterr().out
    assert "GYRO_4.csv: 19 rows" in said
    assert "GYRO_4: 1 x corrupt, left out." in said
    assert main(["mcap", str(tmp_path / "run.lcm"), "--out", str(tmp_path / "x.mcap")]) == 0
    said = capsys.readouterr().out
    assert "x.mcap: 18 messages" in said
    assert "GYRO_4: 1 x logged at an impossible time, left out." in said


# MCAP


def test_mcap_holds_every_message_as_json_that_fits_its_schema(log: Path, tmp_path: Path) -> None:
    out = tmp_path / "run.mcap"
    assert main(["mcap", str(log), "--out", str(out)]) == 0
    with out.open("rb") as stream:
        found = list(make_reader(stream, validate_crcs=True).iter_messages(log_time_order=False))
    assert [channel.topic for _, channel, _ in found] == [event.channel for event in WHOLE]
    for (schema, channel, message), event in zip(found, WHOLE, strict=True):
        ours = decode(event.channel, event.data)
        assert schema is not None
        assert (schema.name, schema.encoding, channel.message_encoding) == (
            f"cmr.{ours.stream.message_type.__name__}", "jsonschema", "json"
        )  # fmt: skip
        assert (message.log_time, message.publish_time) == (event.utime * 1000, ours.message.utime * 1000)
        properties, values = json.loads(schema.data)["properties"], json.loads(message.data, parse_constant=refuse)
        for field in fields_of(ours.stream.message_type):
            check_value(field, getattr(ours.message, field.name), values, properties[field.name])


def refuse(constant: str) -> None:
    raise AssertionError(f"{constant} is no JSON")


def check_value(field: Field, ours: Any, values: Row, kind: Row) -> None:
    """See that a value is the message's, and of the kind that the schema says, in words that Foxglove knows."""
    if field.counted_by is None and isinstance(ours, float) and math.isnan(ours):
        assert field.name not in values
        return
    ours, theirs = told(ours), values[field.name]
    assert field.comment == kind["description"]
    pairs = [(ours, theirs)]
    if field.counted_by is not None:
        assert kind["type"] == "array"
        pairs, kind = list(zip(ours, theirs, strict=True)), kind["items"]
    kinds: Row = {"integer": int, "number": int | float, "string": str, "boolean": bool}
    for one, other in pairs:
        assert isinstance(other, kinds[kind["type"]])
        assert one == (np.float32(other) if field.wire_type == "float" else other)
