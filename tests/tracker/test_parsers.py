"""Whatever bytes come from the network, they are a frame or refused: nothing hangs, and nothing else is raised."""

import math
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip("natnet", reason="the extra [tracker] is not installed")
pytest.importorskip("qtm_rt", reason="the extra [tracker] is not installed")
from cmr.tracker.natnet_frames import parse
from cmr.tracker.profile import Tracker
from cmr.tracker.qualisys import Qualisys
from cmr.tracker.source import Source
from cmr.tracker.vrpn import COOKIE, Vrpn
from tests.support.trackers.frame import Body, Emitted
from tests.support.trackers.natnet_server import NatNetServer
from tests.support.trackers.vrpn_server import message

BODIES = [Body(f"b{k}", 0.1 * k, 0.2, 0.3) for k in range(3)]
numbers = st.floats(-50.0, 50.0, width=32)
versions = st.sampled_from([(3, 0), (3, 1), (4, 0), (4, 1), (4, 2)])
bodies = st.lists(st.tuples(numbers, numbers, st.floats(-3.0, 3.0), st.booleans()), max_size=8)


def frame_of(version: tuple[int, int], content: list[Body]) -> bytes:
    server = NatNetServer(version)
    try:
        return server._frame(Emitted(7, 1.5, 1.504, content))
    finally:
        server.close()


@settings(deadline=None)
@given(versions, bodies)
def test_a_natnet_frame_holds_the_bodies_that_are_tracked(
    version: tuple[int, int], content: list[tuple[float, float, float, bool]]
) -> None:
    sent = [Body(f"b{k}", x, y, theta, tracked) for k, (x, y, theta, tracked) in enumerate(content)]
    frame = parse(frame_of(version, sent), version)
    tracked = [(number, body) for number, body in enumerate(sent, start=1) if body.tracked]
    assert frame.number == 7
    assert frame.transmitted - frame.exposure == 40_000
    assert frame.bodies.ids == tuple(number for number, _ in tracked)
    for (_, body), position in zip(tracked, frame.bodies.positions, strict=True):
        assert position == pytest.approx((body.x, body.y, body.z), rel=1e-6, abs=1e-6)


@settings(deadline=None)
@given(versions, st.data())
def test_a_natnet_frame_that_is_cut_or_damaged_is_refused_or_read(
    version: tuple[int, int], data: st.DataObject
) -> None:
    whole = bytearray(frame_of(version, BODIES))
    end = data.draw(st.integers(0, len(whole)))
    for _ in range(data.draw(st.integers(0, 4))):
        whole[data.draw(st.integers(0, len(whole) - 1))] = data.draw(st.integers(0, 255))
    _is_refused_or_read(bytes(whole[:end]), version)


@given(st.binary(max_size=400), versions)
def test_any_bytes_are_a_natnet_frame_or_refused(data: bytes, version: tuple[int, int]) -> None:
    _is_refused_or_read(data, version)


def _is_refused_or_read(data: bytes, version: tuple[int, int]) -> None:
    try:
        frame = parse(data, version)
    except ValueError:
        return
    assert len(frame.bodies.ids) == len(frame.bodies.positions)


def feed(source: Source, data: bytes) -> None:
    """Let a source read bytes as if they had come."""
    source._stream.receive = lambda: data  # type: ignore[attr-defined]
    for sample in source.read():
        assert len(sample.names) == len(sample.positions) == len(sample.quaternions)


@settings(deadline=None)
@given(st.lists(st.binary(max_size=120), max_size=5))
def test_any_bytes_of_a_qtm_server_are_read_or_end_the_connection(parts: list[bytes]) -> None:
    source = Qualisys(Tracker("qualisys", "127.0.0.1"))
    for part in parts:
        feed(source, part)


@pytest.mark.parametrize("packet", [struct.pack("<II", 0, 3), struct.pack("<IIqIIII", 32, 3, 0, 0, 2**32 - 1, 0, 5)])
def test_packets_that_would_be_read_for_ever_end_the_connection(packet: bytes) -> None:
    source = Qualisys(Tracker("qualisys", "127.0.0.1"))
    feed(source, packet)
    assert "what is not QTM's protocol" in source._stream.problem


@settings(deadline=None)
@given(st.lists(st.binary(max_size=120), max_size=5), st.booleans())
def test_any_bytes_of_a_vrpn_server_are_read_or_end_the_connection(parts: list[bytes], greeted: bool) -> None:
    source = Vrpn(Tracker("vrpn", "127.0.0.1"))
    for part in [COOKIE, *parts] if greeted else parts:
        feed(source, part)


@settings(deadline=None)
@given(st.lists(st.integers(1, 97), min_size=1, max_size=30))
def test_vrpn_messages_may_come_in_any_parts(sizes: list[int]) -> None:
    pose = struct.pack(">ii3d4d", 2, 0, 1.0, 2.0, 3.0, 0.0, 0.0, 0.6, 0.8)
    text = b"hall\0"
    stream = COOKIE
    stream += message(0, 5, -1, struct.pack(">I", len(text)) + text)
    kind = b"vrpn_Tracker Pos_Quat\0"
    stream += message(0, 9, -2, struct.pack(">I", len(kind)) + kind)
    stream += message(1_700_000_000_123_456, 5, 9, pose)
    source, samples, at = Vrpn(Tracker("vrpn", "127.0.0.1")), [], 0
    while at < len(stream):
        part = stream[at : at + sizes[at % len(sizes)]]
        at += len(part)
        source._stream.receive = lambda part=part: part  # type: ignore[method-assign, misc]
        samples += source.read()
    (sample,) = samples
    assert sample.names == ("hall/2",)
    assert sample.measured == pytest.approx(1_700_000_000.123456, abs=1e-6)
    assert np.allclose(sample.positions, [[1.0, 2.0, 3.0]])
    assert math.isclose(sample.quaternions[0][3], 0.8)
