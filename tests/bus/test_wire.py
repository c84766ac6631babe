"""The wire is what interfaces.md says, is documented where it is defined, and lets nothing damaged through."""

import itertools
import re
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cmr import msg
from cmr.bus.message import Message
from cmr.bus.messages import REASONS, Received, RejectedMessage, decode, make
from cmr.bus.streams import LCM_CHANNEL_NAME_LIMIT, MOTOR_COMMAND, STREAMS, Stream, identify
from cmr.cli.configuration import LARGEST_ROBOT_ID
from tests.support.project import PROJECT
from tests.support.typed_messages import as_a

LCM_TYPES = sorted((PROJECT / "lcmtypes").glob("*.lcm"))

# interfaces.md, section 2: the fields of each type in their order.
WIRE = {
    "robot_state_t": """int64_t utime; int32_t robot_id; int8_t origin; double x; double y; double theta;
        double psi_left; double psi_right; double domega_left; double domega_right""",
    "world_state_t": """int64_t utime; int32_t n; int32_t robot_id[n]; int8_t origin[n]; float x[n]; float y[n];
        float theta[n]; float psi_left[n]; float psi_right[n]; float domega_left[n]; float domega_right[n]""",
    "motor_command_t": "int64_t utime; int32_t robot_id; double left; double right",
    "wheel_speed_command_t": "int64_t utime; int32_t robot_id; double psi_left; double psi_right",
    "velocity_command_t": "int64_t utime; int32_t robot_id; double v; double omega",
    "motor_feedback_t": """int64_t utime; int32_t robot_id; int64_t ticks_left; int64_t ticks_right; double psi_left;
        double psi_right; double applied_left; double applied_right; double current_left; double current_right;
        double battery_voltage; double temperature; int32_t status; int64_t received_utime; int64_t applied_utime""",
    "motor_duty_t": "int64_t utime; int32_t robot_id; double sent_left; double sent_right",
    "gyro_t": "int64_t utime; int32_t robot_id; double yaw_rate; int8_t valid; int64_t received_utime",
    "pose_xyt_t": "int64_t utime; int32_t robot_id; double x; double y; double theta",
    "waypoints_t": "int64_t utime; int32_t robot_id; int32_t n; double x[n]; double y[n]",
    "range_scan_t": """int64_t utime; int32_t robot_id; double angle_first; double angle_step; double range_max;
        int32_t n; float ranges[n]""",
    "camera_image_t": "int64_t utime; string camera; int32_t width; int32_t height; int32_t n; byte jpeg[n]",
    "parameters_t": "int64_t utime; int32_t robot_id; int64_t sequence; string sha256; string yaml",
    "calibration_status_t": """int64_t utime; int32_t robot_id; int8_t state; double progress; double k2_over_k3;
        double k1; double base_width; double k2_over_k3_std; double k1_std; double base_width_std;
        double path_rmse_before; double path_rmse_after; string message""",
    "investigation_status_t": """int64_t utime; int32_t robot_id; int8_t state; double driven; double longest;
        string explanations; string named; int32_t excluded; int32_t not_shown; string movement; string first;
        string second; int32_t members; int32_t n; float x[n]; float y[n]; string message""",
    "process_status_t": """int64_t utime; string process; string host; int32_t pid; int8_t state;
        string parameters_sha256; double loop_rate_hz; double loop_overruns; string message""",
    "estop_t": "int64_t utime; boolean engaged; string source; string reason",
    "estop_latch_t": """int64_t utime; int32_t robot_id; boolean engaged; boolean stored; int64_t since_utime;
        string source; string reason""",
    "process_request_t": """int64_t utime; boolean wanted; boolean once; string host; string run; string name;
        string role; string command; string after; string files""",
    "command_claim_t": "int64_t utime; int32_t robot_id; int8_t action; string claimant",
    "command_owner_t": "int64_t utime; int32_t robot_id; int64_t sender; int64_t since_utime; string owner",
}
CONSTANTS = {
    "command_claim_t": ["CLAIM", "TAKE_OVER", "END"],
    "robot_state_t": ["REAL", "VIRTUAL", "TWIN"],
    "calibration_status_t": ["WAITING", "COLLECTING", "FITTING", "DONE", "FAILED"],
    "investigation_status_t": ["OPENING", "DRIVING", "PLANNING", "DONE", "FAILED"],
    "process_status_t": ["STARTING", "RUNNING", "DEGRADED", "STOPPING"],
}

robot_ids = st.integers(0, LARGEST_ROBOT_ID)
streams = st.sampled_from(STREAMS)


def sample(stream: Stream[Message], robot_id: int = 7) -> tuple[str, bytes]:
    """Return a channel of the stream and a valid message for it, with entries in every array and string."""
    message_type = stream.message_type
    fields: dict[str, Any] = {}
    empty = message_type()
    for name, kind, size in zip(empty.__slots__, empty.__typenames__, empty.__dimensions__, strict=True):
        value: Any = "some text" if kind == "string" else 1
        fields[name] = [value] * 3 if size else value
    if "robot_id" in fields and stream.per_robot:
        fields["robot_id"] = robot_id
    fields.pop("n", None)
    channel = stream.channel(robot_id if stream.per_robot else None)
    return channel, make(message_type, **fields).encode()


def decodes_or_is_rejected(channel: str, data: bytes, stream: Stream[Message]) -> None:
    """Any exception but RejectedMessage fails the test."""
    try:
        received = decode(channel, data)
    except RejectedMessage as rejected:
        reason = rejected.reason
    else:
        assert isinstance(received, Received)
        assert isinstance(received.message, stream.message_type)
        return
    assert reason in REASONS


def test_the_types_are_those_of_the_interface_and_each_is_on_a_channel() -> None:
    assert [path.stem for path in LCM_TYPES] == sorted(WIRE)
    assert {stream.message_type.__name__ for stream in STREAMS} == set(WIRE)


@pytest.mark.parametrize("name", WIRE)
def test_fields_types_and_order_are_those_of_the_interface(name: str) -> None:
    message = getattr(msg, name)()
    fields = [
        f"{kind} {field}" + (f"[{size[0]}]" if size else "")
        for field, kind, size in zip(message.__slots__, message.__typenames__, message.__dimensions__, strict=True)
    ]
    assert fields == re.split(r";\s+", WIRE[name])


@pytest.mark.parametrize("name", CONSTANTS)
def test_states_are_numbered_as_in_the_interface(name: str) -> None:
    message_type = getattr(msg, name)
    assert [getattr(message_type, constant) for constant in CONSTANTS[name]] == list(range(len(CONSTANTS[name])))


def test_all_fingerprints_differ_because_lcm_ignores_the_names_of_types() -> None:
    fingerprints = {name: getattr(msg, name)._get_packed_fingerprint() for name in WIRE}
    assert len(set(fingerprints.values())) == len(WIRE)


@pytest.mark.parametrize("path", LCM_TYPES, ids=lambda path: path.stem)
def test_a_file_holds_one_type_of_its_own_name_in_our_package(path: Path) -> None:
    code = re.sub(r"//.*", "", path.read_text())
    assert re.findall(r"package\s+([\w.]+)\s*;", code) == ["cmr.msg"]
    assert re.findall(r"struct\s+(\w+)", code) == [path.stem]


@pytest.mark.parametrize("path", LCM_TYPES, ids=lambda path: path.stem)
def test_every_field_and_constant_is_explained_above_its_line(path: Path) -> None:
    lines = [line.strip() for line in path.read_text().splitlines()]
    explained = 0
    for above, line in itertools.pairwise(lines):
        if re.match(r"(const\s+)?(int\d+_t|double|float|string|boolean|byte)\s", line):
            assert re.match(r"// \S", above), f"no comment above: {line}"
            explained += 1
        elif line.startswith("struct "):
            assert re.match(r"// \S", above), f"no comment above: {line}"
    assert explained
    trailing = [line for line in lines if "//" in line and not line.startswith("//")]
    assert not trailing, "lcm-gen attaches a trailing comment to the next field"


@given(streams, robot_ids)
def test_every_channel_name_fits_lcm(stream: Stream[Message], robot_id: int) -> None:
    longest = stream.channel(LARGEST_ROBOT_ID if stream.per_robot else None)
    name = stream.channel(robot_id if stream.per_robot else None)
    assert len(name.encode()) <= len(longest.encode()) <= LCM_CHANNEL_NAME_LIMIT


@given(streams, robot_ids)
def test_a_channel_name_tells_its_stream_and_robot(stream: Stream[Message], robot_id: int) -> None:
    robot = robot_id if stream.per_robot else None
    assert identify(stream.channel(robot)) == (stream, robot)
    assert re.fullmatch(stream.pattern, stream.channel(robot))


def test_the_largest_robot_id_is_what_a_message_holds() -> None:
    channel, data = sample(MOTOR_COMMAND, LARGEST_ROBOT_ID)
    assert decode(channel, data).robot_id == LARGEST_ROBOT_ID


@pytest.mark.parametrize("robot_id", [None, -1, LARGEST_ROBOT_ID + 1])
def test_there_is_no_channel_of_a_robot_that_cannot_be(robot_id: int | None) -> None:
    with pytest.raises(ValueError, match="MOTOR_COMMAND needs a robot id"):
        MOTOR_COMMAND.channel(robot_id)


@pytest.mark.parametrize(
    "name",
    [
        "",
        "MOTOR_COMMAND",
        "MOTOR_COMMAND_",
        "MOTOR_COMMAND_00",
        "MOTOR_COMMAND_07",
        "MOTOR_COMMAND_-1",
        "MOTOR_COMMAND_+1",
        "MOTOR_COMMAND_1.0",
        "MOTOR_COMMAND_1\n",
        "MOTOR_COMMAND_\u0661",  # a digit, but not an ASCII one
        f"MOTOR_COMMAND_{LARGEST_ROBOT_ID + 1}",
        "motor_command_1",
        "XMOTOR_COMMAND_1",
        "MOTOR_COMMANDS_1",
        "ESTOP_1",
        "estop",
        " ESTOP",
        "POSE_1_2",
        "SLAM_POSE",
        "WORLD_STATE_0",
    ],
)
def test_look_alikes_are_no_channels_of_ours(name: str) -> None:
    assert identify(name) is None


@given(st.text(max_size=70))
def test_any_other_name_is_none_of_ours_or_exactly_ours(name: str) -> None:
    identity = identify(name)
    assert identity is None or identity[0].channel(identity[1]) == name


def test_make_counts_the_arrays_and_keeps_them_whole() -> None:
    message = make(msg.waypoints_t, utime=1, robot_id=2, x=[1.0, 2.0, 3.0], y=[4.0, 5.0, 6.0])
    assert message.n == 3
    decoded = as_a(msg.waypoints_t, decode("WAYPOINTS_2", message.encode()).message)
    assert (decoded.n, decoded.x, decoded.y) == (3, (1.0, 2.0, 3.0), (4.0, 5.0, 6.0))
    assert make(msg.waypoints_t, utime=1, robot_id=2, x=[], y=[]).n == 0


def test_make_refuses_arrays_of_unequal_length() -> None:
    with pytest.raises(ValueError, match=r"waypoints_t.*'x': 2.*'y': 1"):
        make(msg.waypoints_t, utime=1, robot_id=2, x=[1.0, 2.0], y=[4.0])


@pytest.mark.parametrize(
    ("message_type", "fields", "named"),
    [
        (msg.motor_command_t, {"utime": 1, "robot_id": 0, "left": 0.5}, "right"),
        (msg.motor_command_t, {"utime": 1, "robot_id": 0, "left": 0.5, "right": 0.5, "rigth": 0.5}, "rigth"),
        (msg.waypoints_t, {"utime": 1, "robot_id": 0, "x": [1.0]}, "y"),
        (msg.waypoints_t, {"utime": 1, "robot_id": 0}, "x, y"),
    ],
)
def test_make_names_fields_that_are_missing_or_unknown(message_type: Any, fields: dict[str, Any], named: str) -> None:
    with pytest.raises(TypeError, match=rf"{message_type.__name__}.*missing or unknown.*\b{named}"):
        make(message_type, **fields)


@pytest.mark.parametrize("stream", STREAMS, ids=lambda stream: stream.name)
def test_a_valid_message_arrives_as_it_was_sent(stream: Stream[Message]) -> None:
    channel, data = sample(stream)
    received = decode(channel, data)
    assert (received.stream, received.robot_id) == (stream, 7 if stream.per_robot else None)
    assert received.message.encode() == data


@given(streams, st.binary(max_size=300), st.booleans())
def test_random_bytes_never_raise_anything_else(stream: Stream[Message], data: bytes, fingerprint: bool) -> None:
    channel = sample(stream)[0]
    start = stream.message_type._get_packed_fingerprint() if fingerprint else b""
    decodes_or_is_rejected(channel, start + data, stream)


@given(streams, st.data())
def test_a_truncated_message_never_raises_anything_else(stream: Stream[Message], choose: st.DataObject) -> None:
    channel, data = sample(stream)
    decodes_or_is_rejected(channel, data[: choose.draw(st.integers(0, len(data) - 1))], stream)


@given(streams, st.data())
def test_flipped_bytes_never_raise_anything_else(stream: Stream[Message], choose: st.DataObject) -> None:
    channel, data = sample(stream)
    flipped = bytearray(data)
    for place in choose.draw(st.lists(st.integers(0, len(data) - 1), min_size=1, max_size=8)):
        flipped[place] ^= choose.draw(st.integers(1, 255))
    decodes_or_is_rejected(channel, bytes(flipped), stream)


def test_every_reason_for_rejection_can_be_met_and_says_where() -> None:
    channel, data = sample(MOTOR_COMMAND, 7)
    foreign = sample(next(stream for stream in STREAMS if stream.name == "GYRO"))[1]
    cases = {
        "unknown_channel": ("SLAM_POSE", data),
        "foreign": (channel, foreign),
        "corrupt": (channel, data[:-1]),
        "wrong_robot": ("MOTOR_COMMAND_8", data),
    }
    assert set(cases) == set(REASONS)
    for reason, (name, content) in cases.items():
        with pytest.raises(RejectedMessage, match=name) as rejected:
            decode(name, content)
        assert rejected.value.reason == reason


@pytest.mark.parametrize("n", [-1, 1000, 2**31 - 1])
def test_a_count_that_lies_is_corrupt(n: int) -> None:
    channel, data = sample(next(stream for stream in STREAMS if stream.name == "WORLD_STATE"))
    with pytest.raises(RejectedMessage) as rejected:
        decode(channel, data[:16] + n.to_bytes(4, "big", signed=True) + data[20:])
    assert rejected.value.reason == "corrupt"


def test_feedback_from_before_it_told_when_the_duty_was_sent_is_read_as_before() -> None:
    stream = next(stream for stream in STREAMS if stream.name == "MOTOR_FEEDBACK")
    channel, data = sample(stream)
    before = bytes.fromhex("17ee2f1946253fa0") + data[8:-8]
    message = as_a(msg.motor_feedback_t, decode(channel, before).message)
    assert (message.utime, message.received_utime, message.applied_utime) == (1, 1, 0)
    assert as_a(msg.motor_feedback_t, decode(channel, before + b"more").message).applied_utime == 0
    with pytest.raises(RejectedMessage, match="corrupt"):
        decode(channel, before[:-1])


@pytest.mark.parametrize("stream", STREAMS, ids=lambda stream: stream.name)
def test_a_received_message_knows_its_stream_and_robot_and_type(stream: Stream[Message]) -> None:
    channel, data = sample(stream)
    received = decode(channel, data)
    assert received.message_of(stream) is received.message
    assert not any(received.message_of(other) for other in STREAMS if other is not stream)
