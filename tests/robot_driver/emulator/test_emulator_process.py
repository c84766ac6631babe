"""The emulator as others meet it: a real process, real pseudo-terminals, clients that nobody here wrote."""

import contextlib
import fcntl
import itertools
import math
import os
import select
import signal
import subprocess
import sys
import termios
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import serial
from basicmicro import Basicmicro

from cmr.bus.bus import Bus
from cmr.bus.messages import Received, make, now_utime
from cmr.bus.streams import GYRO, MOTOR_FEEDBACK, POSE, PROCESS_STATUS, VELOCITY_COMMAND
from cmr.msg import velocity_command_t
from robot_driver.terminals.pseudo_terminal import Ports, PortsError
from tests.support.typed_messages import all_of

pytestmark = pytest.mark.waits

BUS_URL = "udpm://239.255.76.67:7698?ttl=0&recv_buf_size=4194304"
START = [sys.executable, "-c", "from cmr.commands import emulate; raise SystemExit(emulate())"]
ADDRESS = 0x80
PATIENCE = 120.0  # s; far more than anything here takes on a loaded machine that may compile, too


class Emulator:
    """A running cmr-emulate with its ports in `folder`."""

    def __init__(self, folder: Path, *arguments: str) -> None:
        self.motor, self.gyro = folder / "motor", folder / "gyro"
        command = [*START, "--ports", str(folder), *arguments]
        environment = os.environ | {"LCM_DEFAULT_URL": BUS_URL}
        self.process = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        assert self.process.stdout is not None
        if not select.select([self.process.stdout], [], [], PATIENCE)[0]:
            self.process.kill()
            raise AssertionError(f"no port after {PATIENCE:.0f} s")
        self.first_line = self.process.stdout.readline().decode()

    def end(self, number: int = signal.SIGTERM) -> tuple[int, float, bytes]:
        """Send a signal; return exit code, seconds until the end, and what was written to stderr."""
        start = time.monotonic()
        self.process.send_signal(number)
        _, errors = self.process.communicate(timeout=PATIENCE)
        return self.process.returncode, time.monotonic() - start, errors


@contextlib.contextmanager
def running(folder: Path, *arguments: str) -> Iterator[Emulator]:
    emulator = Emulator(folder, *arguments)
    try:
        yield emulator
    finally:
        if emulator.process.poll() is None:
            emulator.end()


@contextlib.contextmanager
def client_of(emulator: Emulator) -> Iterator[Basicmicro]:
    # The library gives up after `timeout` between bytes; 1 s keeps a loaded machine from failing the test.
    client = Basicmicro(str(emulator.motor), 115200, timeout=1.0)
    assert client.Open()
    try:
        yield client
    finally:
        client.close()


def counts_of(client: Basicmicro) -> tuple[int, int]:
    _, left, right = client.GetEncoders(ADDRESS)
    return (left + 2**31) % 2**32 - 2**31, (right + 2**31) % 2**32 - 2**31


@pytest.fixture
def emulator(tmp_path: Path) -> Iterator[Emulator]:
    with running(tmp_path / "ports", "--no-pose", "--ideal") as emulator:
        yield emulator


def test_the_first_line_names_both_ports(emulator: Emulator) -> None:
    assert emulator.first_line.split()[-4:] == ["motor", str(emulator.motor), "gyro", str(emulator.gyro)]


def test_at_its_end_it_names_what_it_did_not_understand(tmp_path: Path) -> None:
    with running(tmp_path / "ports", "--no-pose", "--controller", "roboteq") as emulator:
        with serial.Serial(str(emulator.motor), timeout=PATIENCE) as port:
            port.write(b"?NIX 1\r?NIX 2\r!P 1 100\r?FF\r")
            port.read_until(b"FF=0\r")
        emulator.process.send_signal(signal.SIGTERM)
        said, _ = emulator.process.communicate(timeout=PATIENCE)
    assert said.decode() == "cmr-emulate: not understood on port motor: ?NIX (2), !P (1)\n"


def test_a_client_nobody_here_wrote_reads_everything_it_asks_for(emulator: Emulator) -> None:
    with client_of(emulator) as client:
        assert client.ReadVersion(ADDRESS) == (True, "USB Roboclaw 2x15a v4.2.8\n")
        assert tuple(client.ReadMainBatteryVoltage(ADDRESS)) == (True, 124)
        assert tuple(client.ReadLogicBatteryVoltage(ADDRESS)) == (True, 50)
        assert tuple(client.GetEncoders(ADDRESS)) == (True, 0, 0)
        assert tuple(client.ReadCurrents(ADDRESS)) == (True, 0, 0)
        assert tuple(client.ReadTemp(ADDRESS)) == (True, 315)
        assert tuple(client.ReadError(ADDRESS)) == (True, 0)
        assert tuple(client.ReadBuffers(ADDRESS)) == (True, 0x80, 0x80)
        assert client.GetStatus(ADDRESS)[5:7] == (124, 50)
        assert client.SetTimeout(ADDRESS, 0.5)
        assert tuple(client.GetTimeout(ADDRESS)) == (True, 0.5)


def test_the_wheels_turn_and_the_encoders_count_at_the_speed_of_the_duty(emulator: Emulator) -> None:
    with client_of(emulator) as client:
        assert client.DutyM1M2(ADDRESS, 8000, -4000)
        time.sleep(1.5)  # nine time constants
        before, start = counts_of(client), time.monotonic()
        time.sleep(1.0)
        after, seconds = counts_of(client), time.monotonic() - start
        assert client.ReadPWMs(ADDRESS) == (True, 8000, -4000)
    ticks_per_radian = 2048 / (2.0 * math.pi)
    for duty, count in zip((8000, -4000), (after[0] - before[0], after[1] - before[1]), strict=True):
        speed = duty / 32767 / 0.054
        # The two clock readings lie a request apart from the encoder readings: some milliseconds of a second.
        assert count / ticks_per_radian / seconds == pytest.approx(speed, rel=0.02)


def test_the_device_stops_the_motors_when_the_host_falls_silent(emulator: Emulator) -> None:
    with client_of(emulator) as client:
        client.SetTimeout(ADDRESS, 0.3)
        client.DutyM1M2(ADDRESS, 8000, 8000)
        time.sleep(3.0)
        assert client.ReadPWMs(ADDRESS) == (True, 0, 0)
        before = counts_of(client)
        assert before[0] > 0
        for _ in range(10):  # asking does not start them again
            time.sleep(0.05)
            assert client.ReadPWMs(ADDRESS) == (True, 0, 0)
        assert counts_of(client) == pytest.approx(before, abs=1)


def test_the_gyro_sees_a_clockwise_turn_as_positive(emulator: Emulator) -> None:
    with client_of(emulator) as client, serial.Serial(str(emulator.gyro), 38400, timeout=PATIENCE) as gyro:
        client.DutyM1M2(ADDRESS, 3000, -3000)
        time.sleep(1.5)
        gyro.reset_input_buffer()
        gyro.readline()
        lines = [gyro.readline() for _ in range(50)]
    rate = math.degrees(0.04 * (2 * 3000 / 32767 / 0.054) / 0.161)
    values = [float(line.split()[0]) for line in lines]
    assert all(len(line) == 21 and line.endswith(b"   1\r\n") for line in lines)
    assert sum(values) / len(values) == pytest.approx(rate, abs=math.degrees(0.005))


def test_a_port_survives_clients_that_close_and_reopen_it_and_keeps_nothing_for_them(emulator: Emulator) -> None:
    for _ in range(3):
        with open_again(emulator.gyro) as gyro:
            fcntl.ioctl(gyro.fileno(), termios.TIOCEXCL)
            assert gyro.readline().endswith(b"\r\n")
        time.sleep(0.3)
    raw = open_descriptor(emulator.gyro)  # unlike pyserial, it does not discard what was there before
    try:
        assert select.select([raw], [], [], PATIENCE)[0]
        assert len(os.read(raw, 4096)) <= 2 * 21
    finally:
        os.close(raw)


def open_again(path: Path) -> serial.Serial:
    """Open a port that another client has just closed; it may take a moment to become free."""
    deadline = time.monotonic() + PATIENCE
    while True:
        try:
            return serial.Serial(str(path), 38400, timeout=PATIENCE)
        except serial.SerialException:
            if time.monotonic() > deadline:
                raise
            time.sleep(0.02)


def open_descriptor(path: Path) -> int:
    deadline = time.monotonic() + PATIENCE
    while True:
        try:
            return os.open(path, os.O_RDWR | os.O_NOCTTY)
        except OSError:
            if time.monotonic() > deadline:
                raise
            time.sleep(0.02)


def test_what_a_client_writes_before_it_closes_is_carried_out(emulator: Emulator) -> None:
    descriptor = open_descriptor(emulator.motor)
    os.write(descriptor, bytes.fromhex("80 22 1f40 e0c0 830d"))
    os.close(descriptor)
    time.sleep(0.3)
    with client_of(emulator) as client:
        assert client.ReadPWMs(ADDRESS) == (True, 8000, -8000)


def test_a_client_that_does_not_read_blocks_nobody(emulator: Emulator) -> None:
    with serial.Serial(str(emulator.gyro), 38400), client_of(emulator) as client:
        time.sleep(3.0)  # 6 kB of gyro lines: more than a pseudo-terminal holds
        assert client.ReadVersion(ADDRESS)[0]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("arguments", [(), ("--no-pose",)])
def test_a_signal_ends_it_within_a_second_and_leaves_nothing(
    tmp_path: Path, number: int, arguments: tuple[str, ...]
) -> None:
    folder = tmp_path / "ports"
    with running(folder, *arguments) as emulator, serial.Serial(str(emulator.gyro), 38400):
        assert emulator.motor.is_symlink()
        code, seconds, errors = emulator.end(number)
    assert code == 130
    assert {line.split()[-1] for line in errors.splitlines()} <= {b"ready", b"stopped"}, errors
    assert seconds < 1.0
    assert not folder.exists()


def test_the_pose_is_on_the_bus_at_its_rate_with_its_noise_and_strictly_later_stamps(tmp_path: Path) -> None:
    bus = Bus(BUS_URL)
    bus.subscribe(POSE, 7, every=True)
    bus.subscribe(PROCESS_STATUS, every=True)
    with running(tmp_path / "ports", "--robot", "7", "--pose-rate", "100"):
        received: list[Received] = []
        deadline = time.monotonic() + PATIENCE
        while sum(one.stream is POSE for one in received) < 200 and time.monotonic() < deadline:
            received += bus.receive(0.1)
    poses = all_of(POSE, received)
    statuses = all_of(PROCESS_STATUS, received)
    assert len(poses) >= 200
    assert "cmr-emulate" in {status.process for status in statuses}
    assert abs(poses[-1].utime - time.time_ns() // 1000) < 5_000_000
    steps = [later.utime - earlier.utime for earlier, later in itertools.pairwise(poses)]
    # Stamped with the moment of measurement: even, however late the process was. The host's clock may be slewed.
    assert all(9_000 < step < 11_000 for step in steps)
    assert math.sqrt(sum(pose.x**2 for pose in poses) / len(poses)) == pytest.approx(0.003, rel=0.3)


def test_a_robot_with_a_velocity_controller_is_commanded_on_the_bus_and_tells_what_it_does_there(
    tmp_path: Path,
) -> None:
    bus = Bus(BUS_URL)
    for stream in (MOTOR_FEEDBACK, GYRO, POSE):
        bus.subscribe(stream, 7, every=True)
    with running(tmp_path / "ports", "--robot", "7", "--command", "velocity", "--ideal") as emulator:
        assert "VELOCITY_COMMAND_7" in emulator.first_line
        received: list[Received] = []
        deadline = time.monotonic() + PATIENCE
        while time.monotonic() < deadline:
            command = make(velocity_command_t, utime=now_utime(), robot_id=7, v=0.2, omega=1.0)
            bus.publish(VELOCITY_COMMAND, command, 7)
            received += bus.receive(0.02)
            if (poses := all_of(POSE, received[-1:])) and poses[0].x > 0.05:
                break
    speeds = all_of(MOTOR_FEEDBACK, received)[-1]
    assert 0.04 * 0.5 * (speeds.psi_left + speeds.psi_right) == pytest.approx(0.2, rel=0.2)  # it may still set off
    assert all_of(GYRO, received)[-1].yaw_rate == pytest.approx(1.0, rel=0.2)


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["--settings", "/nonexistent.yaml"], 1, "/nonexistent.yaml: cannot be read"),
        (["--robot", "-1"], 2, "a robot id is a whole number"),
        (["--pose-rate", "0"], 2, "--pose-rate must be"),
        (["--ports", "/proc/ports"], 1, "Choose another --ports"),
    ],
)
def test_a_wrong_argument_is_one_line_on_stderr(arguments: list[str], code: int, said: str) -> None:
    ended = subprocess.run([*START, "--no-pose", *arguments], capture_output=True, text=True, timeout=PATIENCE)
    assert ended.returncode == code
    assert said in ended.stderr.splitlines()[-1]


def test_help_shows_an_example() -> None:
    ended = subprocess.run([*START, "--help"], capture_output=True, text=True, timeout=PATIENCE)
    assert ended.returncode == 0
    assert "cmr-driver --port" in ended.stdout
    assert "what FILE.yaml of --settings hides" in " ".join(ended.stdout.split())


def test_an_impossible_effect_is_refused_with_file_key_value_and_range(tmp_path: Path) -> None:
    file = tmp_path / "robot.yaml"
    file.write_text("effects: {command_loss: 2}\n")
    ended = subprocess.run(
        [*START, "--no-pose", "--settings", str(file)], capture_output=True, text=True, timeout=PATIENCE
    )
    assert ended.returncode == 1
    assert f"{file}: line 1: effects.command_loss must be 0 to 1, not 2." in ended.stderr


def test_a_second_emulator_in_the_same_folder_is_refused_and_the_first_keeps_its_links(tmp_path: Path) -> None:
    with Ports(tmp_path, ("motor",)) as first:
        with pytest.raises(PortsError, match="Another emulator"), Ports(tmp_path, ("motor",)):
            pass
        assert first.paths["motor"].resolve().is_char_device()
    assert list(tmp_path.iterdir()) == []


def test_a_stale_link_is_replaced_but_a_users_file_is_not(tmp_path: Path) -> None:
    (tmp_path / "motor").symlink_to("/dev/pts/nonexistent")
    with Ports(tmp_path, ("motor",)) as ports:
        assert ports.paths["motor"].resolve().is_char_device()
    (tmp_path / "gyro").write_text("mine")
    with pytest.raises(PortsError, match="is not a link"), Ports(tmp_path, ("motor", "gyro")):
        pass
    assert [path.name for path in tmp_path.iterdir()] == ["gyro"]
