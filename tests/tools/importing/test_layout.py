"""Promises of reading foreign LCM messages by a layout written as text."""

import struct
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cmr.bus.messages import make
from cmr.msg import motor_feedback_t, pose_xyt_t
from cmr_tools.importing.layout import LayoutError, column_names, decode, message_bytes, parse_layout

FINGERPRINT = b"\x01\x23\x45\x67\x89\xab\xcd\xef"
# type: (struct code, values)
NUMBERS: dict[str, tuple[str, st.SearchStrategy[Any]]] = {
    "int8_t": ("b", st.integers(-(2**7), 2**7 - 1)),
    "int16_t": ("h", st.integers(-(2**15), 2**15 - 1)),
    "int32_t": ("i", st.integers(-(2**31), 2**31 - 1)),
    "int64_t": ("q", st.integers(-(2**63), 2**63 - 1)),
    "float": ("f", st.floats(width=32, allow_nan=False)),
    "double": ("d", st.floats(allow_nan=False)),
    "boolean": ("b", st.integers(0, 1)),
    "byte": ("B", st.integers(0, 255)),
}


@st.composite
def structs(draw: st.DrawFn) -> tuple[str, list[str], list[list[Any]], list[bytes]]:
    """A layout, its columns, the values of some messages and the messages' bytes as LCM writes them."""
    members = draw(st.lists(st.tuples(st.sampled_from(sorted(NUMBERS)), st.integers(0, 4)), min_size=1, max_size=8))
    text, columns, code, values = "", [], ">", []
    for index, (kind, count) in enumerate(members):
        text += f"{kind} m{index}{f'[{count}]' if count else ''}; "
        columns += [f"m{index}[{i}]" for i in range(count)] or [f"m{index}"]
        code += NUMBERS[kind][0] * max(count, 1)
        values += [NUMBERS[kind][1]] * max(count, 1)
    messages = draw(st.lists(st.tuples(*values).map(list), min_size=1, max_size=5))
    return text, columns, messages, [FINGERPRINT + struct.pack(code, *message) for message in messages]


@given(structs())
def test_any_flat_struct_comes_back_as_it_was_encoded(
    case: tuple[str, list[str], list[list[Any]], list[bytes]],
) -> None:
    text, columns, messages, payloads = case
    layout = parse_layout(text)
    assert {len(payload) for payload in payloads} == {message_bytes(layout)}
    decoded = decode(layout, b"".join(payloads))
    assert list(decoded) == columns == list(column_names(layout))
    for index, column in enumerate(columns):
        assert decoded[column].tolist() == [message[index] for message in messages]


def test_messages_of_lcm_s_own_encoder_are_read() -> None:
    message = make(pose_xyt_t, utime=1_700_000_000_000_000, robot_id=7, x=1.5, y=-2.25, theta=0.125)
    layout = parse_layout(
        "struct pose_xyt_t { int64_t utime; // [us]\n int32_t robot_id; /* id */ double x, y, theta; }"
    )
    decoded = decode(layout, message.encode())
    assert [decoded[name].tolist() for name in ("utime", "robot_id", "x", "y", "theta")] == [
        [1_700_000_000_000_000],
        [7],
        [1.5],
        [-2.25],
        [0.125],
    ]


def test_types_may_be_written_without_their_ending() -> None:
    assert parse_layout("int64 utime; int32 n[2]") == parse_layout("int64_t utime; int32_t n[2];")


def test_numbers_keep_their_type_so_that_narrow_counters_can_wrap() -> None:
    decoded = decode(parse_layout("int32_t ticks"), FINGERPRINT + struct.pack(">i", 5))
    assert decoded["ticks"].dtype == np.int32


@pytest.mark.parametrize(
    "text",
    [
        "",
        "string name;",
        "int32_t n; double x[n];",
        "int32_t",
        "int32_t a, a;",
        "double x[0]",
        "struct p { pose_t q; }",
    ],
)
def test_what_has_no_fixed_length_is_refused_with_what_is_allowed(text: str) -> None:
    with pytest.raises(LayoutError, match=r"types are|fixed count|at least one member"):
        parse_layout(text)


def test_our_own_feedback_type_can_be_described() -> None:
    text = "int64_t utime; int32_t robot_id; int64_t ticks[2]; double rest[8]; int32_t status; int64_t since[2];"
    names = motor_feedback_t.__slots__
    numbers = {name: 0 if name.endswith("utime") or name == "status" else 1 for name in names}
    assert len(make(motor_feedback_t, **numbers).encode()) == message_bytes(parse_layout(text))
