"""What reading a recording promises: arrays from a log are what its messages, taken one by one, make."""

import dataclasses
import random
import tracemalloc
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import lcm
import numpy as np
import pytest

from cmr.bus.messages import make
from cmr.bus.streams import STREAMS
from cmr.bus.wire import WIRE_TYPES, layout_of
from cmr.msg import gyro_t, motor_command_t, motor_feedback_t, parameters_t, pose_xyt_t
from cmr.recordings import Recorder, Recording, RecordingError, read_messages, read_robots
from cmr.recordings.arrivals import KEPT
from cmr.recordings.events import LogReader
from tests.support.emulated_drive import EPOCH, NOMINAL, Message, messages, write_log

Event = tuple[str, bytes]  # channel, data
FIXED_SIZE = [
    stream.message_type
    for stream in STREAMS
    if set(stream.message_type.__typenames__) <= set(WIRE_TYPES) and not any(stream.message_type.__dimensions__)
]


@pytest.fixture(scope="module")
def drive() -> list[Message]:
    return messages(seconds=6.0)


def write_events(path: Path, events: list[Event]) -> Path:
    log = lcm.EventLog(str(path), "w", overwrite=True)
    for number, (channel, data) in enumerate(events):
        log.write_event(EPOCH + number, channel, data)
    log.close()
    return path


def one_by_one(log: Path, robot_id: int = 0) -> tuple[Recorder, Counter[tuple[str, str]]]:
    recorder, reader = Recorder(robot_id), LogReader(log)
    for received in reader:
        recorder.handle(received.message.utime, received.channel, received.message)
    return recorder, reader.rejected


def assert_same(one: Recording, other: Recording) -> None:
    assert one.parameters == other.parameters
    for name, signal in one.signals.items():
        assert np.array_equal(signal.utime, other.signals[name].utime), name
        assert signal.left_out == other.signals[name].left_out, name
        for field, values in signal.fields.items():
            assert np.array_equal(values, other.signals[name][field], equal_nan=True), (name, field)


def odd(drive: list[Message], seed: int) -> Iterator[Event]:
    """Yield a drive's messages as a careless world delivers them."""
    rng = random.Random(seed)
    for channel, message in drive:
        message = type(message).decode(message.encode())
        data = message.encode()
        chance = rng.random()
        if chance < 0.05:
            message.utime -= rng.randrange(100_000)  # late
            data = message.encode()
        elif chance < 0.10:
            yield channel, data  # twice
        elif chance < 0.13:
            data = data[: rng.randrange(len(data))]
        elif chance < 0.16:
            data = data + b"more"
        elif chance < 0.19:
            data = bytes(8) + data[8:]
        elif chance < 0.22:
            message.robot_id = 1
            data = message.encode()
        elif chance < 0.25:
            fields = [n for n, t in zip(message.__slots__, message.__typenames__, strict=True) if t == "double"]
            if fields:
                setattr(message, rng.choice(fields), rng.choice([np.nan, np.inf, -np.inf]))
            data = message.encode()
        elif chance < 0.28 and isinstance(message, gyro_t):
            message.valid = 0
            data = message.encode()
        elif chance < 0.30:
            yield "SOMEBODY_ELSES", b"whatever"
        yield channel, data


@pytest.mark.parametrize("message_type", FIXED_SIZE)
def test_the_bytes_of_every_type_of_fixed_size_lie_as_its_own_encoder_puts_them(message_type: Any) -> None:
    layout = layout_of(message_type)
    values: dict[str, float] = {}
    for place, (name, wire_type) in enumerate(zip(message_type.__slots__, message_type.__typenames__, strict=True)):
        values[name] = (
            place * 1.5 if wire_type in ("double", "float") else (place * 7 + 3) % 2 if name == "engaged" else place
        )
    encoded = make(message_type, **values).encode()
    assert layout.itemsize == len(encoded)
    decoded = np.frombuffer(encoded, layout)[0]
    assert {name: decoded[name] for name in values} == values


def test_every_stream_that_a_recording_keeps_is_of_fixed_size() -> None:
    assert {kept.stream.message_type for kept in KEPT.values()} <= set(FIXED_SIZE)
    text_inside: Any = parameters_t
    with pytest.raises(TypeError, match="sha256 is not of fixed size"):
        layout_of(text_inside)


def test_arrays_from_a_log_are_what_its_messages_make_one_by_one(drive: list[Message], tmp_path: Path) -> None:
    log = write_log(tmp_path / "run.lcm", drive)
    recording = Recording.read(log)
    assert_same(recording, one_by_one(log)[0].recording())
    counts = Counter(channel for channel, _ in drive)
    assert {name: len(getattr(recording, name)) for name in KEPT} == {
        name: counts[kept.stream.channel(0)] for name, kept in KEPT.items()
    }
    first = next(message for channel, message in drive if channel == "MOTOR_FEEDBACK_0")
    assert recording.wheels.utime[0] == first.utime
    assert recording.wheels["ticks_left"][0] == first.ticks_left


@pytest.mark.parametrize("seed", range(5))
def test_a_careless_worlds_log_is_taken_alike_at_once_and_one_by_one(
    drive: list[Message], seed: int, tmp_path: Path
) -> None:
    log = write_events(tmp_path / "run.lcm", list(odd(drive, seed)))
    recording, (recorder, rejected) = Recording.read(log), one_by_one(log)
    assert_same(recording, recorder.recording())
    assert recording.rejected == rejected
    assert {reason for _, reason in rejected} == {"unknown_channel", "foreign", "corrupt", "wrong_robot"}
    assert read_messages(log).measured == recorder.measured
    assert all(np.all(np.diff(signal.utime) > 0) for signal in recording.signals.values())


def test_what_processes_send_to_test_the_bus_is_no_fault_of_a_log(drive: list[Message], tmp_path: Path) -> None:
    tests_of_the_bus = [("LCM_SELF_TEST", b"lcm self test"), ("CMR_SELF_TEST", b"token")]
    events = [(channel, message.encode()) for channel, message in drive]
    log = write_events(tmp_path / "run.lcm", [*tests_of_the_bus, *events, *tests_of_the_bus])
    recording, (recorder, rejected) = Recording.read(log), one_by_one(log)
    assert not recording.rejected
    assert not rejected
    assert_same(recording, recorder.recording())


def test_every_message_is_a_sample_or_counted_with_its_reason(drive: list[Message], tmp_path: Path) -> None:
    events = list(odd(drive, 1))
    recording = Recording.read(write_events(tmp_path / "run.lcm", events))
    for name, kept in KEPT.items():
        channel, signal = kept.stream.channel(0), getattr(recording, name)
        rejected = sum(count for (at, _), count in recording.rejected.items() if at == channel)
        sent = sum(at == channel for at, _ in events)
        assert len(signal) + sum(signal.left_out.values()) + rejected == sent, name


@pytest.mark.parametrize("damage", ["channel name", "sync word", "truncated"])
def test_damage_costs_the_damaged_events_only_and_is_counted_in_bytes(
    damage: str, drive: list[Message], tmp_path: Path
) -> None:
    log = write_log(tmp_path / "run.lcm", drive)
    whole = Recording.read(log)
    content = bytearray(log.read_bytes())
    event = content.index(b"MOTOR_FEEDBACK_0", len(content) // 2) - 28
    if damage == "channel name":
        content[event + 28] = 0xFF
    elif damage == "sync word":
        content[event] ^= 0xFF
    else:
        del content[event + 100 :]
    log.write_bytes(content)
    damaged = Recording.read(log)
    assert whole.damaged_bytes == 0 < damaged.damaged_bytes
    assert_same(damaged, one_by_one(log)[0].recording())
    samples = sum(len(signal) for signal in whole.signals.values())
    lost = samples - sum(len(signal) for signal in damaged.signals.values())
    assert lost == 1 if damage != "truncated" else lost > samples // 3


def test_an_empty_file_and_one_that_is_no_log_hold_no_robot(tmp_path: Path) -> None:
    for content in (b"", bytes(1000), random.Random(1).randbytes(100_000)):
        (tmp_path / "run.lcm").write_bytes(content)
        with pytest.raises(RecordingError, match="no MOTOR_FEEDBACK_N or POSE_N"):
            Recording.read(tmp_path / "run.lcm")
    with pytest.raises(RecordingError, match=r"none\.lcm: cannot be opened: No such file"):
        Recording.read(tmp_path / "none.lcm")


def test_robots_of_one_log_are_kept_apart(drive: list[Message], tmp_path: Path) -> None:
    def renamed(channel: str, message: Any) -> Event:
        other = type(message).decode(message.encode())
        other.robot_id = 7
        return channel.replace("_0", "_7"), other.encode()

    events = [event for pair in drive for event in ((pair[0], pair[1].encode()), renamed(*pair))]
    log = write_events(tmp_path / "run.lcm", events)
    with pytest.raises(RecordingError, match=r"robots \[0, 7\]"):
        Recording.read(log)
    assert Recording.read(log, 7).robot_id == 7
    robots = read_robots(log)
    assert_same(Recording.of(robots[0]), dataclasses.replace(Recording.of(robots[7]), robot_id=0))


def test_the_largest_time_seen_so_far_and_what_had_come_are_those_of_the_messages_one_by_one(
    drive: list[Message], tmp_path: Path
) -> None:
    log = write_events(tmp_path / "run.lcm", list(odd(drive, 2)))
    robot = read_messages(log)
    numbers, latest = robot.latest_utime()
    recorder, seen, count = Recorder(0), 0, 0
    cut = len(numbers) // 3
    for received in LogReader(log):
        seen = max(seen, received.message.utime)
        assert latest[count] == seen
        recorder.handle(seen, received.channel, received.message)
        count += 1
        if count == cut + 1:
            assert_same(Recording.of(robot.until(int(numbers[cut]))), recorder.recording())
            assert np.array_equal(robot.until(int(numbers[cut])).latest_utime()[1], latest[:count])
    assert count == len(numbers)


def test_a_parameter_file_is_known_from_its_announcement_on_and_a_broken_one_changes_nothing(tmp_path: Path) -> None:
    def announcement(sequence: int, radius: float) -> Event:
        values = {"wheel_radius": dataclasses.replace(NOMINAL.values["wheel_radius"], value=radius)}
        return "PARAMETERS_0", dataclasses.replace(NOMINAL, values=values).announcement(sequence=sequence).encode()

    broken = NOMINAL.announcement(sequence=9)
    broken.yaml = "schema: 1\nrobot_id: ["
    pose = make(pose_xyt_t, utime=EPOCH, robot_id=0, x=0.0, y=0.0, theta=0.0)
    events = [announcement(2, 0.1), announcement(1, 0.2), ("PARAMETERS_0", broken.encode()), announcement(3, 0.3)]
    robot = read_messages(write_events(tmp_path / "run.lcm", [("POSE_0", pose.encode()), *events]))
    radii = [robot.until(number).parameters for number in range(5)]
    assert [radius and radius.value("wheel_radius") for radius in radii] == [None, 0.1, 0.1, 0.1, 0.3]


def test_forgetting_drops_what_was_measured_before_and_keeps_the_parameters(drive: list[Message]) -> None:
    recorder = Recorder(0)
    for channel, message in drive:
        recorder.handle(message.utime, channel, message)
    whole, since = recorder.recording(), EPOCH + 3_000_000
    recorder.forget(since)
    assert_same(recorder.recording(), whole.between(since, EPOCH + 10**9))
    assert recorder.parameters == NOMINAL


def test_a_recorder_holds_an_hour_in_less_than_a_hundred_bytes_a_message() -> None:
    message = make(
        motor_feedback_t,
        **dict.fromkeys(motor_feedback_t.__slots__, 0),
    )
    recorder = Recorder(0)
    tracemalloc.start()
    for utime in range(20_000):
        message.utime = utime
        recorder.handle(utime, "MOTOR_FEEDBACK_0", message)
    held = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    assert held < 20_000 * 100  # two integers and six floats are 64; the arrays grow by eighths


@pytest.mark.slow
def test_reading_takes_at_most_three_times_the_logs_size_in_memory(drive: list[Message], tmp_path: Path) -> None:
    log = write_log(tmp_path / "run.lcm", drive * 20)
    Recording.read(log)
    tracemalloc.start()
    Recording.read(log)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 3 * log.stat().st_size


def test_samples_can_be_set_aside_by_signal(drive: list[Message]) -> None:
    recorder = Recorder(0)
    for channel, message in drive:
        recorder.handle(message.utime, channel, message)
    recording = recorder.recording()
    keep = np.arange(len(recording.poses)) % 2 == 0
    half = recording.where({"poses": keep})
    assert np.array_equal(half.poses["x"], recording.poses["x"][::2])
    assert half.wheels is recording.wheels


def test_commands_keep_only_finite_duties() -> None:
    recorder = Recorder(0)
    for utime, left in enumerate([0.1, np.nan, np.inf, 0.2]):
        command = make(motor_command_t, utime=utime, robot_id=0, left=left, right=0.0)
        recorder.handle(utime, "MOTOR_COMMAND_0", command)
    commands = recorder.recording().commands
    assert commands["left"].tolist() == [0.1, 0.2]
    assert commands.number.tolist() == [0, 3]
    assert commands.left_out == {"not a finite number": 2}


def speed_commands(seconds: float, *kinds: str) -> Recording:
    """Commands of these kinds, ten a second, of one robot that told a pose."""
    recorder = Recorder(0)
    fields = {"MOTOR_COMMAND": {"left": 0.1, "right": 0.2}, "WHEEL_SPEED_COMMAND": {"psi_left": 2.0, "psi_right": 3.0}}
    fields["VELOCITY_COMMAND"] = {"v": 0.4, "omega": 0.5}
    streams = {stream.name: stream for stream in STREAMS}
    for number in range(round(10 * seconds)):
        utime = EPOCH + 100_000 * number
        recorder.handle(utime, "POSE_0", make(pose_xyt_t, utime=utime, robot_id=0, x=0.0, y=0.0, theta=0.0))
        for kind in kinds:
            message = make(streams[kind].message_type, utime=utime, robot_id=0, **fields[kind])
            recorder.handle(utime, f"{kind}_0", message)
    return recorder.recording()


@pytest.mark.parametrize(
    ("kinds", "kind"),
    [
        (("VELOCITY_COMMAND",), "velocity"),
        (("WHEEL_SPEED_COMMAND",), "wheel_speed"),
        (("MOTOR_COMMAND",), "duty"),
        (("VELOCITY_COMMAND", "WHEEL_SPEED_COMMAND"), "wheel_speed"),
        (("VELOCITY_COMMAND", "MOTOR_COMMAND"), "duty"),
        ((), "duty"),
    ],
)
def test_a_recording_knows_what_its_robot_was_commanded(kinds: tuple[str, ...], kind: str) -> None:
    assert speed_commands(1.0, *kinds).command_kind == kind


def test_speeds_that_stand_for_duties_are_still_known_to_have_been_speeds() -> None:
    recorded = speed_commands(1.0, "VELOCITY_COMMAND")
    assert recorded.velocity_commands["omega"].tolist() == [0.5] * 10
    converted = recorded.with_duties(np.full(10, 0.2), np.full(10, 0.3))
    assert converted.command_kind == "velocity"
    assert converted.duty.utime.tolist() == recorded.velocity_commands.utime.tolist()
    assert converted.between(EPOCH, EPOCH + 450_000).duty["right"].tolist() == [0.3] * 5
