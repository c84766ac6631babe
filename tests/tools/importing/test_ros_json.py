"""Promises of importing MCAP files with JSON messages: those of cmr-log mcap, and what others write."""

import json
import math
from pathlib import Path
from typing import Any

import lcm
import pytest
from mcap.writer import CompressionType, Writer

from cmr.bus.messages import decode, make
from cmr.bus.streams import GYRO, MOTOR_COMMAND, MOTOR_FEEDBACK, POSE
from cmr.cli.errors import CommandError
from cmr_tools.importing import import_log
from cmr_tools.logs import main as log_main
from tests.support.ros_bags import mapping_of, run

START = 1_700_000_000_000_000  # us


def write_log(path: Path) -> dict[str, list[Any]]:
    """Write a run of robot 0, with what JSON cannot say among its numbers; return its messages by channel."""
    messages: dict[str, list[Any]] = {}
    log = lcm.EventLog(str(path), "w")
    for i in range(20):
        utime = START + 10_000 * i
        turning = {"ticks_left": 2**40 + 7 * i, "ticks_right": -3 * i, "psi_left": 0.1 * i, "psi_right": 1e-9 * i}
        unknown = dict.fromkeys(("applied_left", "applied_right", "current_left", "current_right"), math.nan)
        unknown |= dict.fromkeys(("battery_voltage", "temperature"), math.nan)
        for stream, fields in (
            (MOTOR_COMMAND, {"left": 0.3 + 1e-6 * i, "right": -1.0}),
            (MOTOR_FEEDBACK, {**turning, **unknown, "status": 0, "received_utime": utime + 500, "applied_utime": 0}),
            (GYRO, {"yaw_rate": math.pi / (i + 1), "valid": 1, "received_utime": utime + 500}),
            (POSE, {"x": 1 / 3 + i, "y": -i, "theta": 0.01 * i}),
        ):
            message = make(stream.message_type, utime=utime, robot_id=0, **fields)
            messages.setdefault(stream.channel(0), []).append(message)
            log.write_event(utime + 500, stream.channel(0), message.encode())
    log.close()
    return messages


def test_a_run_that_went_through_mcap_comes_back_with_the_same_numbers(tmp_path: Path) -> None:
    sent = write_log(tmp_path / "run.lcm")
    mcap, back = tmp_path / "run.mcap", tmp_path / "back.lcm"
    assert log_main.main(["mcap", str(tmp_path / "run.lcm"), "--out", str(mcap)]) == 0
    assert import_log.main(["cmr_mcap", str(mcap), "--out", str(back)]) == 0
    received: dict[str, list[Any]] = {}
    for event in lcm.EventLog(str(back), "r"):
        received.setdefault(event.channel, []).append(decode(event.channel, event.data).message)
    for message in sent["MOTOR_FEEDBACK_0"]:
        message.ticks_left -= 2**40  # a count begins with the recording
    assert {name: len(messages) for name, messages in received.items()} == {
        "PARAMETERS_0": 1,
        **{name: len(messages) for name, messages in sent.items()},
    }
    for name, messages in sent.items():
        assert [one.encode() for one in received[name]] == [one.encode() for one in messages]


def write_json(path: Path, contents: list[bytes], topic: str = "/gyro") -> Path:
    with path.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.NONE)
        writer.start()
        channel = writer.register_channel(topic=topic, message_encoding="json", schema_id=0)
        for number, data in enumerate(contents):
            writer.add_message(channel, log_time=(START + number) * 1000, publish_time=1, data=data)
        writer.finish()
    return path


def gyro_mapping(clock: str = "received", field: str = "rates[1].z") -> dict[str, Any]:
    return mapping_of({"/gyro": clock}, gyro={"topic": "/gyro", "yaw_rate": {"field": field, "unit": "rad/s"}})


def reading(value: Any, **more: Any) -> bytes:
    return json.dumps({"rates": [{"z": 9.0}, {"z": value}], **more}).encode()


def test_json_of_others_is_read_by_path_and_what_is_no_number_is_counted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    broken = [
        b"{",
        b"\xff",
        b"[]",
        b"null",
        b'"text"',
        reading(None),
        reading("fast"),
        reading({"a": 1}),
        b'{"rates": 3}',
    ]
    bag = write_json(tmp_path / "x.mcap", [reading(0.5), *broken, reading(1e999), reading(-2)])
    assert [one.yaw_rate for one in run(tmp_path, gyro_mapping(), bag)["GYRO_0"]] == [0.5, -2.0]
    said = capsys.readouterr().out
    assert "/gyro: 2 x message that does not decode" in said
    assert "/gyro: 3 x message with a field that is no number" in said
    assert "/gyro: 3 x message with no 'rates'" in said


def test_a_header_in_json_is_a_time_in_seconds_and_nanoseconds(tmp_path: Path) -> None:
    stamps = [{"sec": 5, "nsec": 1000}, {"sec": 6, "nanosec": 0}]
    bag = write_json(tmp_path / "x.mcap", [reading(1.0, header={"stamp": stamp}) for stamp in stamps])
    assert [one.utime for one in run(tmp_path, gyro_mapping("header"), bag)["GYRO_0"]] == [5_000_001, 6_000_000]


@pytest.mark.parametrize(
    ("clock", "field", "said"),
    [
        ("received", "rates[7].z", r"/gyro: no message has all mapped fields: no rates\[7\]; rates has 2 elements"),
        ("received", "rates[1].w", "no message has all mapped fields: no 'w'; there is z"),
        ("header", "rates[1].z", "no 'header'; there is rates"),
        ("header", "rates[x].z", "no 'header'; there is rates"),
    ],
)
def test_what_json_lacks_is_named_with_what_there_is(tmp_path: Path, clock: str, field: str, said: str) -> None:
    with pytest.raises(CommandError, match=said):
        run(tmp_path, gyro_mapping(clock, field), write_json(tmp_path / "x.mcap", [reading(1.0)]))


def test_a_topic_of_another_encoding_is_said(tmp_path: Path) -> None:
    path = tmp_path / "x.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        channel = writer.register_channel(topic="/gyro", message_encoding="protobuf", schema_id=0)
        writer.add_message(channel, log_time=1, publish_time=1, data=b"abc")
        writer.finish()
    with pytest.raises(CommandError, match=r"/gyro \(protobuf\) is encoded as protobuf; read are ros1, cdr and json"):
        run(tmp_path, gyro_mapping(), path)
