"""KVH binary gyros: read as they are set, never changed, and nothing that they did not measure is ever believed."""

import dataclasses
import math
import os
import random
import struct
import sys
from collections.abc import Iterator, Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_driver.emulator.device import Transmission
from robot_driver.emulator.kvh_binary_device import KvhBinaryDevice
from robot_driver.emulator.plant import Plant
from robot_driver.gyros import GYROS, GyroReading
from robot_driver.gyros.kvh_binary import ENTER_CONFIGURATION, LEAVE_CONFIGURATION, KvhBinary
from robot_driver.gyros.kvh_messages import Answer, Sample, SelfTest, Stream, checksum
from tests.robot_driver.emulator.test_emulator_kvh_binary import kvh_settings
from tests.robot_driver.golden_vectors import KVH_SAMPLE, KVH_SELF_TEST

FACTORY = {"ROTFMT": "DELTA", "ROTUNITS": "RAD", "DR": "1000", "MSYNC": "IMU", "AXES": "1,0,0,0,1,0,0,0,1"}
RATES = FACTORY | {"ROTFMT": "RATE"}


def message(z: float, sequence: int = 0, *, status: int = 0x77, x: float = 0.0, y: float = 0.0) -> bytes:
    """Return a message of format A."""
    data = KVH_SAMPLE[:4] + struct.pack(">6fBBh", x, y, z, 0.0, 0.0, 1.0, status, sequence % 128, 25)
    return data + struct.pack(">I", checksum(data))


def interviewed(settings: dict[str, str], name: str = "kvh-binary") -> KvhBinary:
    """Return the protocol after it has been told the settings of its device."""
    gyro = GYROS[name]()
    assert isinstance(gyro, KvhBinary)
    assert gyro.next_request() == b""
    interview(gyro, settings)
    return gyro


def interview(gyro: KvhBinary, settings: dict[str, str]) -> None:
    """Answer all questions as a device does that is in configuration mode, and does not know what is not set."""
    gyro.feed(b"CONFIG,1\r\n")
    while (request := gyro.next_request()) != LEAVE_CONFIGURATION:
        query = request.decode().strip().removeprefix("?")
        gyro.feed(f"CFG>{query},{settings[query]}\r\n".encode() if query in settings else b"INVALID," + request)


def rates(readings: Sequence[GyroReading]) -> list[float]:
    return [reading.yaw_rate for reading in readings if reading.valid]


def test_the_manuals_sample_is_a_rate() -> None:
    assert rates(interviewed(FACTORY).feed(KVH_SAMPLE)) == pytest.approx([-1.3111248e-2], rel=1e-6)


@pytest.mark.parametrize(("last", "length", "status"), [(0x55, 36, 28), (0x56, 40, 32), (0x57, 38, 32)])
def test_all_three_formats_are_read(last: int, length: int, status: int) -> None:
    data = bytearray(b"\xfe\x81\xff" + bytes([last]) + struct.pack(">fff", 1.0, 2.0, 3.0) + bytes(length - 20))
    data[status : status + 2] = b"\x72\x05"
    stream = bytes(data) + struct.pack(">I", checksum(bytes(data)))
    (sample,) = Stream().feed(stream)
    assert sample == Sample((1.0, 2.0, 3.0), 0x72, 5, length)


@pytest.mark.parametrize(
    ("settings", "rate"),
    [
        (RATES, 0.25),
        (RATES | {"ROTUNITS": "DEG"}, math.radians(0.25)),
        (RATES | {"MSYNC": "EXT"}, 0.25),
        (FACTORY | {"DR": "50"}, 0.25 * 50),
        (FACTORY | {"DR": "100", "ROTUNITS": "DEG"}, math.radians(25.0)),
    ],
)
def test_rates_and_angles_in_both_units_become_rad_per_second(settings: dict[str, str], rate: float) -> None:
    assert rates(interviewed(settings).feed(message(0.25))) == pytest.approx([rate])


@pytest.mark.parametrize(("name", "rate"), [("kvh-binary", 3.0), ("kvh-binary-x", 1.0), ("kvh-binary-y", -2.0)])
def test_counter_clockwise_is_positive_about_the_axis_that_points_up(name: str, rate: float) -> None:
    assert rates(interviewed(RATES, name).feed(message(3.0, x=1.0, y=-2.0))) == [rate]


@pytest.mark.parametrize(("status", "valid"), [(0x77, True), (0x04, True), (0x73, False), (0x00, False)])
def test_what_the_sensor_does_not_vouch_for_has_no_rate(status: int, valid: bool) -> None:
    (reading,) = interviewed(RATES).feed(message(0.5, status=status))
    assert (reading.valid, math.isnan(reading.yaw_rate)) == (valid, not valid)


def test_an_axis_turned_by_the_device_needs_all_sensors_it_is_made_of() -> None:
    turned = RATES | {"AXES": "+0.0E+00,+0.0E+00,-1.0E+00,+0.0E+00,+1.0E+00,+0.0E+00,+1.0E+00,+0.0E+00,+0.0E+00"}
    assert rates(interviewed(turned).feed(message(0.5, status=0x01) + message(0.5, status=0x06))) == [0.5]
    tilted = RATES | {"AXES": "1,0,0,0,0.8,-0.6,0,0.6,0.8"}
    assert rates(interviewed(tilted).feed(b"".join(message(0.5, status=status) for status in range(8)))) == [0.5] * 2


@pytest.mark.parametrize("rotation", [math.nan, math.inf, -math.inf, 17.5, -17.5])
def test_what_no_such_sensor_can_measure_has_no_rate(rotation: float) -> None:
    (reading,) = interviewed(RATES).feed(message(rotation))
    assert not reading.valid
    assert math.isnan(reading.yaw_rate)


def test_nothing_is_read_before_the_settings_are_known() -> None:
    gyro = KvhBinary()
    assert gyro.feed(message(0.5) * 3) == []
    assert gyro.next_request() == b""
    assert gyro.wake_up == ENTER_CONFIGURATION


def test_a_self_test_tells_of_a_power_cycle_and_everything_is_asked_anew() -> None:
    gyro = interviewed(RATES)
    assert len(gyro.feed(message(0.5) + KVH_SELF_TEST + message(0.5))) == 1
    assert gyro.nominal_rate == 0.0
    assert gyro.next_request() == ENTER_CONFIGURATION
    assert gyro.feed(message(0.5)) == []
    assert gyro.next_request() == b""
    interview(gyro, FACTORY | {"DR": "50"})
    assert gyro.nominal_rate == 50.0
    (reading,) = gyro.feed(message(0.25, 77))
    assert (reading.yaw_rate, reading.lost_before) == (12.5, 0)


def test_a_damaged_self_test_is_none() -> None:
    gyro = interviewed(RATES)
    assert len(gyro.feed(message(0.5) + KVH_SELF_TEST[:-1] + b"\x24" + message(0.5, 1))) == 2


def test_only_queries_and_configuration_mode_are_ever_sent() -> None:
    gyro, sent = KvhBinary(), []
    gyro.feed(b"CONFIG,1\r\n")
    while (request := gyro.next_request()) != LEAVE_CONFIGURATION:
        sent.append(request)
        gyro.feed(f"{request[1:-2].decode()},{FACTORY[request[1:-2].decode()]}\n".encode())
    assert sent == [f"?{name}\r\n".encode() for name in FACTORY] * 2


def test_answers_are_believed_when_two_agree() -> None:
    gyro, told = KvhBinary(), iter(["1000", "100", "100", "100"])
    gyro.feed(b"CONFIG,1\r\n")
    while (request := gyro.next_request()) != LEAVE_CONFIGURATION:
        name = request[1:-2].decode()
        gyro.feed(f"{name},{next(told) if name == 'DR' else FACTORY[name]}\r\n".encode())
    assert rates(gyro.feed(message(0.01))) == pytest.approx([1.0])
    assert next(told, None) is None


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        (FACTORY | {"MSYNC": "EXT"}, "Set its =ROTFMT to RATE"),
        (FACTORY | {"DR": "1"}, "Set its =DR to 100"),
        (FACTORY | {"DR": "77"}, "make no sense"),
        (FACTORY | {"ROTUNITS": "GON"}, "ROTUNITS GON"),
        (FACTORY | {"AXES": "1,0"}, "make no sense"),
        (FACTORY | {"AXES": "1,0,0,0,1,0,0,0,one"}, "make no sense"),
        (FACTORY | {"AXES": "1,0,0,0,1,0,0,0,0"}, "make no sense"),
        ({}, "ROTFMT not known"),
    ],
)
def test_a_device_set_so_that_rates_cannot_be_told_is_explained(settings: dict[str, str], said: str) -> None:
    gyro = interviewed(settings)
    assert said in gyro.problem
    assert gyro.feed(message(0.01)) == []


def test_a_device_that_does_not_know_of_turned_axes_has_none() -> None:
    settings = {name: value for name, value in RATES.items() if name != "AXES"}
    assert rates(interviewed(settings).feed(message(0.5, status=0x03) + message(0.5, status=0x04))) == [0.5]


def test_lost_messages_are_counted_also_where_the_numbers_begin_again() -> None:
    numbers = [*range(5), *range(7, 250), *range(260, 300)]
    readings = interviewed(RATES).feed(b"".join(message(0.1, number) for number in numbers))
    lost = {number: reading.lost_before for number, reading in zip(numbers, readings, strict=True)}
    assert {number: count for number, count in lost.items() if count} == {7: 2, 260: 10}


@pytest.mark.parametrize(("changes", "hertz"), [({}, 1000.0), ({"DR": "50"}, 50.0), ({"MSYNC": "EXT"}, 0.0)])
def test_the_devices_own_clock_is_known_unless_it_is_asked_for_messages(changes: dict[str, str], hertz: float) -> None:
    assert interviewed(RATES | changes).nominal_rate == hertz
    assert KvhBinary().nominal_rate == 0.0


def test_a_reading_tells_how_long_ago_it_began() -> None:
    first, second = interviewed(RATES).feed(message(0.1) + message(0.2) + b"    ")
    assert (first.bytes_since, second.bytes_since) == (76, 40)


def test_answers_are_found_behind_the_rest_of_a_damaged_message() -> None:
    stream = KVH_SAMPLE[20:] + b"LETTERS" + KVH_SAMPLE + b"CONFIG,1\r\n" + KVH_SELF_TEST
    assert Stream().feed(stream)[1:] == [Answer("CONFIG", "1"), SelfTest()]


def test_a_line_without_end_is_not_kept() -> None:
    stream = Stream()
    for _ in range(10):
        assert stream.feed(b"A," * 1000) == []
        assert len(stream._line) <= 256


@pytest.mark.parametrize("noise", [b"\xfe", b"\xfe\x81", b"\xfe\x81\xff", b"\x00\xfe"])
def test_noise_that_begins_no_message_is_passed_over_without_a_step_for_each_byte(noise: bytes) -> None:
    calls: list[str] = []
    stream, data = Stream(), noise * (4096 // len(noise))
    sys.setprofile(lambda _frame, event, _: calls.append(event))
    try:
        said = stream.feed(data)
    finally:
        sys.setprofile(None)
    assert said == []
    assert len(calls) < 1000
    assert len(stream.feed(b"\n" + KVH_SAMPLE)) == 1


faults = st.lists(
    st.tuples(st.sampled_from(["flip", "drop", "insert"]), st.integers(0, 10_000), st.integers(0, 255)), max_size=12
)


def damaged(stream: bytes, changes: list[tuple[str, int, int]]) -> tuple[bytes, set[int]]:
    """Return the stream with flipped, dropped and inserted bytes, and the numbers of the messages that suffered."""
    suffered = set()
    result = [bytes([byte]) for byte in stream]
    for kind, place, value in changes:
        place %= len(stream)
        number, inside = divmod(place, 36)
        if kind == "insert":
            result[place] = bytes([value]) + result[place]
            suffered |= {number} if inside else set()
        else:
            result[place] = b"" if kind == "drop" else bytes([stream[place] ^ 1 << value % 8])
            suffered.add(number)
    return b"".join(result), suffered


def in_pieces(stream: bytes, sizes: Sequence[int]) -> Iterator[bytes]:
    for size in sizes:
        yield stream[:size]
        stream = stream[size:]
    yield stream


@given(faults, st.lists(st.integers(1, 50), max_size=40), st.booleans())
def test_whatever_happens_on_the_line_all_whole_messages_come_and_nothing_else(
    changes: list[tuple[str, int, int]], sizes: list[int], byte_by_byte: bool
) -> None:
    truth = [number / 64.0 for number in range(1, 31)]
    stream, suffered = damaged(b"".join(message(rate, n) for n, rate in enumerate(truth)), changes)
    gyro, received = interviewed(RATES), []
    # What follows the last message shows that a damaged header before it does not begin a longer message.
    for piece in in_pieces(stream + bytes(40), [1] * len(stream) if byte_by_byte else sizes):
        received += gyro.feed(piece)
    assert set(rates(received)) <= set(truth)
    assert sorted(rates(received)) == rates(received)
    assert {rate for n, rate in enumerate(truth) if n not in suffered} <= set(rates(received))
    assert sum(reading.lost_before for reading in received) <= len(suffered)


@given(
    st.lists(
        st.one_of(st.binary(max_size=200), st.sampled_from([KVH_SAMPLE, KVH_SELF_TEST, b"CONFIG,1\r\n"])), max_size=20
    )
)
def test_garbage_never_gives_a_reading_nor_fills_the_memory(pieces: list[bytes]) -> None:
    gyro = KvhBinary()
    for piece in pieces:
        assert gyro.feed(piece) == []
        assert len(gyro._stream._waiting) <= 40
        assert len(gyro._stream._line) <= 256


class NoisyLine:
    """A turning robot with a gyro that is switched off and on, and a client that wakes it up after each silence.

    Of all transmissions, both ways, one in a hundred has a bit flipped, a byte dropped or a byte inserted.
    """

    SETTINGS = ((False, False), (True, False), (False, True), (True, True))  # sends rate, degrees

    def __init__(self, seed: int) -> None:
        self.random = random.Random(seed)
        self.plant = Plant(kvh_settings())
        self.gyro = KvhBinary()
        self.truth: set[float] = set()
        self.received: list[float] = []
        self.lost = self.writes = 0
        self.switch_on(0.0)

    def switch_on(self, time: float) -> None:
        sends_rate, degrees = self.random.choice(self.SETTINGS)
        settings = kvh_settings(
            sends_rate=sends_rate, degrees=degrees, rate=self.random.choice((50, 100, 250)), start_up=0.05
        )
        noise = dataclasses.replace(settings.imperfections.gyro_noise, enabled=True)
        imperfections = dataclasses.replace(settings.imperfections, gyro_noise=noise)
        self.scale = (1.0 if sends_rate else float(settings.kvh_binary.rate)) * (math.pi / 180.0 if degrees else 1.0)
        self.device = KvhBinaryDevice(
            dataclasses.replace(settings, imperfections=imperfections, seed=self.random.random()),  # type: ignore[arg-type]
            self.plant,
            time,
        )

    def run(self, messages: int) -> None:
        last_reading = -1.0
        while len(self.truth) < messages:
            time = self.device.wake_time
            if self.random.random() < 0.001:
                self.writes += self.device.writes
                time += 0.6
                self.switch_on(time)
            self.plant.command(-0.1, 0.1 + 0.05 * math.sin(time))
            self.plant.advance(time)
            readings = self._deliver(self.device.wake(time), time)
            if readings:
                last_reading = time
                self.received += rates(readings)
                self.lost += sum(reading.lost_before for reading in readings)
            elif time - last_reading > 0.5:
                self.gyro, last_reading = KvhBinary(), time
                self._deliver(self.device.receive(self.spoilt(self.gyro.wake_up), time), time)

    def _deliver(self, sent: list[Transmission], time: float) -> list[GyroReading]:
        readings = []
        while sent:
            data = b"".join(transmission.data for transmission in sent)
            for sample in Stream().feed(data):
                if isinstance(sample, Sample) and sample.status & 4:
                    self.truth.add(sample.rotation[2] * self.scale)
            data = self.spoilt(data)
            cut = self.random.randrange(len(data) + 1)
            readings += self.gyro.feed(data[:cut]) + self.gyro.feed(data[cut:])
            request = self.gyro.next_request()
            sent = self.device.receive(self.spoilt(request), time) if request else []
        return readings

    def spoilt(self, data: bytes) -> bytes:
        if self.random.random() > 0.01:
            return data
        place = self.random.randrange(len(data))
        odd = bytes([self.random.randrange(256)])
        return data[:place] + self.random.choice([b"", odd, data[place : place + 1] + odd]) + data[place + 1 :]


def test_on_a_noisy_line_with_power_cycles_into_other_modes_only_the_truth_is_published_and_nothing_is_written() -> (
    None
):
    line = NoisyLine(seed=1)
    line.run(int(os.environ.get("CMR_TRANSACTIONS", "10000")))
    assert set(line.received) <= line.truth
    assert len(line.received) > 0.8 * len(line.truth)
    assert line.lost > 0
    assert line.writes + line.device.writes == 0
