"""Who has the key is heard; what anybody else sends, changes or repeats is refused, but an emergency stop."""

import time
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cmr import msg
from cmr.bus.bus import Bus
from cmr.bus.keys import write_new_key
from cmr.bus.messages import Received, decode, make
from cmr.bus.preflight import BusError, key_of
from cmr.bus.signing import (
    MAGIC,
    TRAILER,
    WINDOW,
    RefusedSignature,
    Signer,
    Verifier,
    without_signature,
)
from cmr.bus.streams import ESTOP, MOTOR_COMMAND, POSE, STREAMS, WORLD_STATE
from cmr.cli.configuration import INSECURE

KEY, ANOTHER_KEY = bytes(range(32)), bytes(32)
NOW = 1_700_000_000_000_000
COMMAND = make(msg.motor_command_t, utime=NOW, robot_id=3, left=0.25, right=-0.5)
CHANNEL = "MOTOR_COMMAND_3"
PATIENCE = 5.0  # s


class Clock:
    """A time of day that a test sets [us]."""

    def __init__(self, utime: int = NOW) -> None:
        self.utime = utime

    def __call__(self) -> int:
        return self.utime


def first_heard(bus: Bus) -> Received:
    """Return the first message that is taken; what is refused wakes the bus, too."""
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        for received in bus.receive(0.1):
            return received
    raise AssertionError("nothing was heard")


def refusal(verifier: Verifier, channel: str, data: bytes) -> str:
    """Return why a message is refused; empty if it is taken."""
    try:
        verifier.verify(channel, data)
    except RefusedSignature as refused:
        return refused.reason
    return ""


@given(st.binary(max_size=300), st.text("ABC_0", min_size=1, max_size=20))
def test_what_is_signed_is_taken_as_it_was(data: bytes, channel: str) -> None:
    clock = Clock()
    signer = Signer(KEY, clock)
    signed = Verifier(KEY, clock).verify(channel, signer.sign(channel, data))
    assert signed == (data, signer.sender)


@given(st.integers(0, len(COMMAND.encode()) + TRAILER.size - 1), st.integers(1, 255))
def test_a_message_of_which_any_byte_was_changed_is_refused(place: int, change: int) -> None:
    clock = Clock()
    data = bytearray(Signer(KEY, clock).sign(CHANNEL, COMMAND.encode()))
    data[place] ^= change
    assert refusal(Verifier(KEY, clock), CHANNEL, bytes(data)) in ("forged", "unsigned")


def test_a_signature_is_of_one_channel_and_of_one_key() -> None:
    clock = Clock()
    data = Signer(KEY, clock).sign(CHANNEL, COMMAND.encode())
    assert refusal(Verifier(KEY, clock), "MOTOR_COMMAND_4", data) == "forged"
    assert refusal(Verifier(ANOTHER_KEY, clock), CHANNEL, data) == "forged"


def test_what_is_not_signed_is_refused_by_who_has_a_key_and_taken_by_who_has_none() -> None:
    unsigned = COMMAND.encode()
    named = Signer(None).sign(CHANNEL, unsigned)
    for data in (unsigned, named):
        assert refusal(Verifier(KEY), CHANNEL, data) == "unsigned"
        assert Verifier(None).verify(CHANNEL, data).data == unsigned
    assert Verifier(None).verify(CHANNEL, Signer(KEY).sign(CHANNEL, unsigned)).data == unsigned


def test_a_command_names_its_sender_also_without_a_key_and_nothing_else_does() -> None:
    signer = Signer(None)
    assert Verifier(None).verify(CHANNEL, signer.sign(CHANNEL, COMMAND.encode())).sender == signer.sender
    assert signer.sign("POSE_3", b"a pose") == b"a pose"


def test_a_message_that_comes_again_is_refused_and_so_is_one_of_another_time() -> None:
    clock = Clock()
    signer, verifier = Signer(KEY, clock), Verifier(KEY, clock)
    first, second = (signer.sign(CHANNEL, COMMAND.encode()) for _ in range(2))
    assert refusal(verifier, CHANNEL, second) == ""
    assert refusal(verifier, CHANNEL, second) == "repeated"
    assert refusal(verifier, CHANNEL, first) == "repeated"
    for shift in (-WINDOW - 1, WINDOW + 10):
        late = Clock(NOW + shift)
        assert refusal(Verifier(KEY, late), CHANNEL, first) == "stale"


def test_what_a_verifier_remembers_does_not_grow_and_forgets_nothing_that_could_be_taken_again() -> None:
    clock = Clock()
    verifier = Verifier(KEY, clock)
    messages = []
    for _ in range(200):
        clock.utime += WINDOW // 10
        messages.append(Signer(KEY, clock).sign(CHANNEL, COMMAND.encode()))
        assert refusal(verifier, CHANNEL, messages[-1]) == ""
        assert {refusal(verifier, CHANNEL, each) for each in messages} <= {"repeated", "stale"}
    assert len(verifier._latest) < 40


@pytest.mark.parametrize("hours", [-1, 1])
def test_a_process_whose_clock_was_set_is_heard_again_at_once(hours: int) -> None:
    clock, wrong = Clock(), Clock(NOW - hours * 3_600_000_000)
    signer, verifier = Signer(KEY, wrong), Verifier(KEY, clock)
    assert refusal(verifier, CHANNEL, signer.sign(CHANNEL, COMMAND.encode())) == "stale"
    wrong.utime = clock.utime
    assert refusal(verifier, CHANNEL, signer.sign(CHANNEL, COMMAND.encode())) == ""


def test_anybody_may_stop_the_robots_and_who_has_the_key_alone_may_release_them() -> None:
    def estop(engaged: bool) -> bytes:
        data: bytes = make(msg.estop_t, utime=NOW, engaged=engaged, source="somebody", reason="smoke").encode()
        return data

    verifier = Verifier(KEY, Clock())
    forged = Signer(ANOTHER_KEY, Clock()).sign(ESTOP.name, estop(True))
    for engaged in (estop(True), forged, Signer(KEY, Clock(NOW - 10 * WINDOW)).sign(ESTOP.name, estop(True))):
        assert verifier.verify(ESTOP.name, engaged) == (estop(True), None)
    assert refusal(verifier, ESTOP.name, estop(False)) == "unsigned"
    assert refusal(verifier, ESTOP.name, Signer(ANOTHER_KEY, Clock()).sign(ESTOP.name, estop(False))) == "forged"
    assert refusal(verifier, ESTOP.name, Signer(KEY, Clock()).sign(ESTOP.name, estop(False))) == ""
    assert refusal(verifier, ESTOP.name, b"junk") == "unsigned"
    assert refusal(verifier, MOTOR_COMMAND.channel(3), estop(True)) == "unsigned"


@pytest.mark.parametrize("stream", STREAMS, ids=lambda stream: stream.name)
def test_a_plain_decoder_of_lcm_passes_the_signature_over(stream: object) -> None:
    [message_type] = [each.message_type for each in STREAMS if each is stream]
    encoded = message_type().encode()
    assert message_type.decode(Signer(KEY).sign("X", encoded)).encode() == encoded
    assert without_signature(Signer(KEY).sign("X", encoded)) == encoded


def test_a_world_that_is_signed_is_read_from_a_log_as_it_is() -> None:
    encoded = msg.world_state_t().encode()
    signed = Signer(KEY).sign(WORLD_STATE.name, encoded)
    assert decode(WORLD_STATE.name, signed).message.encode() == encoded


@given(st.binary(max_size=100))
def test_no_bytes_of_a_stranger_do_more_than_be_refused(junk: bytes) -> None:
    for data in (junk, junk + MAGIC, junk + bytes(TRAILER.size - len(MAGIC)) + MAGIC):
        assert refusal(Verifier(KEY), "POSE_0", data) in ("unsigned", "forged")
        Verifier(None).verify("POSE_0", data)


def test_on_the_bus_the_key_decides_and_what_is_refused_is_counted(
    url: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    stranger = Bus(url)
    write_new_key(tmp_path / "key")
    monkeypatch.setenv("CMR_KEY", str(tmp_path / "key"))
    member, other = Bus(url), Bus(url)
    other.subscribe(POSE, every=True)
    other.subscribe(MOTOR_COMMAND, every=True)
    pose = make(msg.pose_xyt_t, utime=NOW, robot_id=0, x=1.0, y=2.0, theta=0.5)
    stranger.publish(POSE, pose, 0)
    stranger.publish(MOTOR_COMMAND, COMMAND, 3)
    member.publish(POSE, pose, 0)
    received = first_heard(other)
    assert received.message.encode() == pose.encode()
    assert received.sender == member._signer.sender
    assert other.rejected == {("POSE_0", "unsigned"): 1, (CHANNEL, "unsigned"): 1}
    monkeypatch.setenv(INSECURE, "1")
    trusting = Bus(url)
    trusting.subscribe(POSE, every=True)
    stranger.publish(POSE, pose, 0)
    assert first_heard(trusting).message.encode() == pose.encode()


def test_a_bus_that_others_share_needs_a_key(monkeypatch: pytest.MonkeyPatch) -> None:
    shared = "udpm://239.255.76.67:7667?ttl=1"
    with pytest.raises(BusError, match="cmr key new"):
        key_of(shared)
    with pytest.raises(BusError, match="cmr key new"):
        key_of("tcpq://lab-server:7700")
    assert key_of("udpm://239.255.76.67:7667?ttl=0") is None
    assert key_of("tcpq://localhost:7700") is None
    monkeypatch.setenv(INSECURE, "1")
    assert key_of(shared) is None
