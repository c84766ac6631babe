"""Roboteq's text protocol: the lines are those of the manual, and only a whole answer to the question is believed."""

import re
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cmr.msg import motor_feedback_t
from robot_driver.controllers import BadReply, Request
from robot_driver.controllers.roboteq import FAULT_FLAGS, MOTOR_FLAGS, Roboteq
from robot_driver.emulator.roboteq_device import RoboteqDevice
from tests.robot_driver.emulated_device import answer
from tests.robot_driver.emulator.test_emulator_roboteq import make_device
from tests.robot_driver.golden_vectors import ROBOTEQ_ANSWERS as ANSWERS

ESTOP, TEMPERATURE = motor_feedback_t.STATUS_ESTOP, motor_feedback_t.STATUS_TEMPERATURE
BATTERY, MOTOR_FAULT = motor_feedback_t.STATUS_BATTERY, motor_feedback_t.STATUS_MOTOR_FAULT
DONE, REFUSED = b"+\r", b"-\r"
ORDER = list(ANSWERS)
COUNTS = st.integers(-(2**31), 2**31 - 1)
INSERTED = b"0123456789-+ _!?GM\r\0\xff"  # what could make another command of one


def every_request(roboteq: Roboteq) -> dict[bytes, Request[Any]]:
    requests: list[Request[Any]] = [
        roboteq.identify(),
        *roboteq.learn(),
        roboteq.set_watchdog(0.5),
        roboteq.read_watchdog(),
        roboteq.drive(0.5, -0.25),
        roboteq.read_encoders(),
        *roboteq.read_telemetry(),
    ]
    requests += [request.then(None) for request in requests if request.then]
    return {request.data: request for request in requests}


def arrived(request: Request[Any], stream: bytes, sizes: Callable[[], int]) -> bytes:
    """Return what is taken for the reply from a stream that comes in pieces, as the port reads it."""
    reply = b""
    while (missing := request.missing(reply)) > 0 and stream:
        size = min(missing, sizes(), len(stream))
        reply, stream = reply + stream[:size], stream[size:]
    return reply


def telemetry(roboteq: Roboteq, query: bytes, answer: bytes) -> Any:
    return every_request(roboteq)[query].parse(answer)


def test_nothing_is_ever_written_to_the_flash() -> None:
    for line in every_request(Roboteq()):
        assert not line.startswith(b"%")
        assert line[:1] in b"?~" or line.split()[0] in (b"!M", b"^ECHOF", b"^RWD")


@pytest.mark.parametrize("duty", [1.001, -1.001])
def test_more_than_full_duty_is_never_sent(duty: float) -> None:
    with pytest.raises(ValueError, match="between -1 and 1"):
        Roboteq().drive(duty, 0.0)


@pytest.mark.parametrize("seconds", [0.0, 66.0])
def test_a_watchdog_that_would_be_off_is_never_set(seconds: float) -> None:
    with pytest.raises(ValueError, match="watchdog"):
        Roboteq().set_watchdog(seconds)


def test_the_answer_to_a_duty_is_the_duty_that_was_really_sent() -> None:
    request = Roboteq().drive(0.12345, -0.98765)
    assert request.data == b"!M 123 -988\r"
    assert request.then is not None
    told = request.then(request.parse(DONE))
    assert told.data == b"?M\r"
    assert told.parse(b"M=123:-988\r") == (0.123, -0.988)


def test_a_controller_that_holds_its_motors_is_told_as_holding_them_and_no_other_duty_is_believed() -> None:
    request = Roboteq().drive(0.3, -0.25)
    assert request.then is not None
    told = request.then(request.parse(DONE))
    assert told.parse(b"M=0:0\r") == (0.0, 0.0)
    for other in (b"M=300:0\r", b"M=0:-250\r", b"M=300:250\r"):
        with pytest.raises(BadReply, match="reports"):
            told.parse(other)


@given(st.sampled_from(ORDER), st.booleans(), st.booleans(), st.data())
def test_an_answer_is_found_in_pieces_of_any_size_with_and_without_echo(
    line: bytes, echo: bool, echo_of_the_end: bool, data: st.DataObject
) -> None:
    request = every_request(Roboteq())[line]
    expected = every_request(Roboteq())[line].parse(ANSWERS[line])
    before = (line if echo_of_the_end else line[:-1]) if echo else b""
    stream = before + ANSWERS[line]
    reply = arrived(request, stream, lambda: data.draw(st.integers(1, 9)))
    assert reply == stream
    assert len(reply) <= request.longest_reply
    assert request.parse(reply) == expected


@pytest.mark.parametrize("answer", [b"C=0:0\r", b"C=-12:345\r", b"C=1234567890:-1234567890\r"])
def test_of_an_answer_as_much_is_read_at_once_as_is_surely_missing(answer: bytes) -> None:
    missing = Roboteq().read_encoders().missing
    asked = [missing(answer[:length]) for length in range(len(answer) + 1)]
    assert all(asked[length] <= len(answer) - length for length in range(len(answer) + 1))
    assert asked[0] == len(b"-\r")  # it may be refused
    assert asked[len(b"C=")] == len(b"0:0\r")
    assert asked[answer.index(b":") + 1] == len(b"0\r")
    assert asked[-1] == 0


@given(st.sampled_from(ORDER), st.binary(max_size=120))
def test_garbage_is_refused_and_never_waited_for_without_end(line: bytes, garbage: bytes) -> None:
    request = every_request(Roboteq())[line]
    reply = arrived(request, garbage + b"x" * 200, lambda: 1)
    assert len(reply) <= request.longest_reply
    if reply.removeprefix(line) == ANSWERS[line] or (reply == REFUSED and line[:2] in (b"~M", b"~C")):
        return
    with pytest.raises(BadReply):
        request.parse(reply)


@given(st.sampled_from(ORDER), st.sampled_from(ORDER), st.booleans())
def test_the_answer_to_another_question_is_refused(asked: bytes, answered: bytes, echo: bool) -> None:
    request, answer = every_request(Roboteq())[asked], ANSWERS[answered]
    if answer.split(b"=")[0] == ANSWERS[asked].split(b"=")[0]:
        return  # two actions are answered alike, and so are a mode's two channels
    with pytest.raises(BadReply):
        request.parse((asked if echo else b"") + answer)


@given(st.permutations(ORDER[-6:]))
def test_answers_in_another_order_are_each_refused_where_they_do_not_belong(order: list[bytes]) -> None:
    requests = every_request(Roboteq())
    for asked, answered in zip(ORDER[-6:], order, strict=True):
        if asked == answered:
            requests[asked].parse(ANSWERS[answered])
        else:
            with pytest.raises(BadReply):
                requests[asked].parse(ANSWERS[answered])


@given(st.sampled_from(ORDER), st.sampled_from(ORDER), st.integers(0, 40))
def test_an_answer_interleaved_with_another_is_refused(asked: bytes, other: bytes, position: int) -> None:
    answer = ANSWERS[asked]
    position = min(position, len(answer) - 1)
    mixed = answer[:position] + ANSWERS[other] + answer[position:]
    request = every_request(Roboteq())[asked]
    reply = arrived(request, mixed, lambda: 1)
    if reply == answer or asked == b"?FID\r":
        return  # the other came after it, for the port to discard; an identity may be any text
    with pytest.raises(BadReply):
        request.parse(reply)


@given(COUNTS, COUNTS)
def test_counts_are_taken_modulo_two_to_the_32(first: int, second: int) -> None:
    answer = Roboteq().read_encoders().parse(b"C=%d:%d\r" % (first, second))
    assert answer == (first % 2**32, second % 2**32)


@given(st.sampled_from(ORDER), st.data())
def test_a_flipped_bit_outside_the_digits_is_never_believed(line: bytes, data: st.DataObject) -> None:
    """There is no checksum, so one digit turned into another cannot be seen."""
    answer = bytearray(ANSWERS[line])
    position = data.draw(st.integers(0, len(answer) - 1))
    before = answer[position]
    answer[position] ^= 1 << data.draw(st.integers(0, 7))
    if line == b"?FID\r" or chr(before).isdigit():
        return
    if before == ord("-") or bytes(answer) == REFUSED:
        return
    with pytest.raises(BadReply):
        every_request(Roboteq())[line].parse(bytes(answer))


@pytest.mark.parametrize(
    "answer",
    b"C=1\r|C=1:2:3\r|C=01:2\r|C=+1:2\r|C= 1:2\r|C=1:2|C=1:2\n|C=-0:2\r|C=1:\r|C=2147483648:0\r"
    b"|C=0:-2147483649\r|CR=1:2\r|c=1:2\r||-\r|+\r|C=1:2\r\r".split(b"|"),
)
def test_what_a_device_does_not_write_is_no_count(answer: bytes) -> None:
    with pytest.raises(BadReply):
        Roboteq().read_encoders().parse(answer)


@pytest.mark.parametrize(
    ("query", "answer"),
    [(b"?V\r", b"V=135:1501:4730\r"), (b"?A\r", b"A=10001:0\r"), (b"?T\r", b"T=30:201\r"), (b"?FF\r", b"FF=-1\r")],
)
def test_what_no_device_can_measure_is_refused(query: bytes, answer: bytes) -> None:
    with pytest.raises(BadReply):
        telemetry(Roboteq(), query, answer)


@pytest.mark.parametrize(
    ("word", "meaning", "words"),
    [
        (0x01, TEMPERATURE, "overheated"),
        (0x02, BATTERY, "too high"),
        (0x04, BATTERY, "too low"),
        (0x08, MOTOR_FAULT, "short-circuited"),
        (0x10, ESTOP, "emergency stop"),
        (0x20, MOTOR_FAULT, "sensor"),
        (0x40, MOTOR_FAULT, "power transistor"),
        (0x80, MOTOR_FAULT, "default values"),
        (0x200, MOTOR_FAULT, "manual"),
    ],
)
def test_fault_flags_mean_what_the_manual_says_in_words(word: int, meaning: int, words: str) -> None:
    said = telemetry(Roboteq(), b"?FF\r", b"FF=%d\r" % word)
    assert said["status"] == meaning
    assert len(said["conditions"]) == 1
    assert words in said["conditions"][0]


def test_flags_of_a_motor_name_the_motor_and_limit_switches_are_no_condition() -> None:
    said = telemetry(Roboteq(), b"?FM\r", b"FM=%d:%d\r" % (0x30, 0x0A))
    assert said["status"] == MOTOR_FAULT | ESTOP
    assert said["conditions"] == ("motor 2 is stalled", "motor 2 is held by the safety stop")


def test_no_bit_is_told_twice() -> None:
    for flags in (FAULT_FLAGS, MOTOR_FLAGS):
        assert sum(bits for bits, _, _ in flags) == sum({bits for bits, _, _ in flags})


def test_faults_and_motor_flags_do_not_hide_each_other_and_go_when_they_are_over() -> None:
    roboteq = Roboteq()
    requests = every_request(roboteq)
    requests[b"?FF\r"].parse(b"FF=4\r")
    both = requests[b"?FM\r"].parse(b"FM=1:0\r")
    assert both["status"] == BATTERY | MOTOR_FAULT
    assert len(both["conditions"]) == 2
    assert requests[b"?FF\r"].parse(b"FF=0\r")["conditions"] == ("motor 1 takes as much current as it may",)


@pytest.mark.parametrize(
    ("mode", "words"),
    [
        ("MMOD 1", "open loop"),
        ("MMOD 2", "open loop"),
        ("MXMD", "separate"),
        ("CLIN 1", "linear"),
        ("CLIN 2", "linear"),
    ],
)
def test_a_controller_that_would_not_take_a_duty_as_a_duty_is_refused(mode: str, words: str) -> None:
    request = every_request(Roboteq())[f"~{mode}\r".encode()]
    with pytest.raises(BadReply, match=words):
        request.parse(f"{mode.split()[0]}=1\r".encode())
    request.parse(REFUSED)  # an old firmware without this setting


def test_a_restarted_device_gets_zeros_and_is_not_believed_until_it_is_armed_anew() -> None:
    roboteq = Roboteq()
    roboteq.learn()[0].parse(DONE)
    roboteq.drive(0.5, 0.5).parse(DONE)
    with pytest.raises(BadReply, match="restarted"):
        roboteq.read_encoders().parse(b"?C\rC=1:2\r")
    drive = roboteq.drive(0.5, 0.5)
    assert drive.data == b"!M 0 0\r"
    for request, reply in ((drive, DONE), (roboteq.read_encoders(), b"C=1:2\r")):
        with pytest.raises(BadReply):
            request.parse(reply)


class Lenient(RoboteqDevice):
    """Takes the first two numbers of a line for the duty, whatever else stands in it."""

    def _answer(self, line: str) -> str:
        numbers = re.findall(r"-?[0-9]+", line)
        return super()._answer(f"!M {numbers[0]} {numbers[1]}" if line[0] == "!" and numbers[1:] else line)


def damages(line: bytes) -> Iterator[bytes]:
    """All that is left of a line when a byte is dropped, a bit flipped, or a byte inserted."""
    for place in range(len(line)):
        yield line[:place] + line[place + 1 :]
        yield from (line[:place] + bytes((line[place] ^ 1 << bit,)) + line[place + 1 :] for bit in range(8))
    for place in range(len(line) + 1):
        yield from (line[:place] + bytes((byte,)) + line[place:] for byte in INSERTED)


def told(device: RoboteqDevice, request: Request[Any], *arriving: bytes) -> Any:
    """Exchange a request as the port does, where these bytes arrive instead of the first lines; None if it fails."""
    reply = arrived(request, answer(device, arriving[0] if arriving else request.data), lambda: 1000)
    try:
        said = request.parse(reply) if request.missing(reply) <= 0 else None
    except BadReply:
        said = None
    return said if said is None or request.then is None else told(device, request.then(said), *arriving[1:])


def driving(kind: type[RoboteqDevice], echo: bool) -> RoboteqDevice:
    device, plant = make_device(echo=echo)
    device = kind(device.settings, plant)
    assert told(device, Roboteq().drive(0.7, 0.6)) == (0.7, 0.6)
    return device


@pytest.mark.parametrize("kind", [RoboteqDevice, Lenient])
@pytest.mark.parametrize("duty", [(0.3, -0.25), (0.0, 0.0)])
def test_3_a_duty_that_was_damaged_on_its_way_is_never_told_as_applied(
    kind: type[RoboteqDevice], duty: tuple[float, float]
) -> None:
    """Nor is the zero at exit, which is the second one; then neither by what is left over of the damaged line."""
    device = driving(kind, echo=False)
    taken_for_another = 0
    for line in damages(Roboteq().drive(*duty).data):
        device._wanted, device._line = [700, 600], b""
        device._apply(device._wanted)
        said = told(device, Roboteq().drive(*duty), line)
        assert said is None or [round(1000 * value) for value in said] == device.duty
        taken_for_another += said is None and device.duty != [700, 600]
        said = told(device, Roboteq().drive(0.0, 0.0))
        assert said is None or device.duty == [0, 0]
    assert taken_for_another > 0


@pytest.mark.parametrize("echo", [True, False])
def test_3_a_duty_counts_only_when_the_device_tells_it(echo: bool) -> None:
    device = driving(RoboteqDevice, echo)
    for line in damages(b"?M\r"):
        device._line = b""
        assert told(device, Roboteq().drive(0.3, -0.25), b"!M 300 250\r", line) is None
        assert told(device, Roboteq().drive(0.3, -0.25), b"!M 300 -250\r", line) in (None, (0.3, -0.25))


def test_3_a_duty_whose_acknowledgement_is_lost_is_not_told_as_applied() -> None:
    request = Roboteq().drive(0.3, -0.25)
    assert request.then is not None
    for lost in (b"", b"\r", b"+", b"M=300:-250\r", b"-\r"):
        with pytest.raises(BadReply):
            request.parse(lost)
    for answered in (b"", b"+\r", b"M=300:250\r", b"M=300\r", b"M=-250:300\r", b"M=300:-250", b"C=300:-250\r", b"-\r"):
        with pytest.raises(BadReply):
            request.then((0.3, -0.25)).parse(answered)
