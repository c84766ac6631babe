"""Promises of importing damaged bags: what is intact is read, the rest is said, and no bytes end in a traceback."""

import re
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType, Writer
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2

from cmr.cli.errors import CommandError
from cmr_tools.importing.mapping import load
from cmr_tools.importing.ros_source import read_bag
from cmr_tools.importing.sources import Source, SourceError
from tests.support.ros_bags import DELAY, GYRO, START, STEP, filled, header, mapping_of, run, typestore

COUNT = 400
MAPPING = mapping_of({"/imu": "header"}, gyro=GYRO)
IMU = "sensor_msgs/msg/Imu"


def imu(is_ros1: bool, i: int) -> bytes:
    store = typestore(is_ros1)
    content = {"header": header(START + i * STEP), "angular_velocity": {"z": 0.25 * i}}
    serialize = store.serialize_ros1 if is_ros1 else store.serialize_cdr
    return bytes(serialize(filled(store, IMU, content), IMU))


def write_ros1(folder: Path, compression: str) -> Path:
    """A bag of chunks of 40 messages."""
    path = folder / f"{compression}.bag"
    writer = Writer1(path)
    if compression:
        writer.set_compression(Writer1.CompressionFormat[compression.upper()])
    writer.chunk_threshold = 40 * 350
    with writer:
        connection = writer.add_connection("/imu", IMU, typestore=typestore(True))
        for i in range(COUNT):
            writer.write(connection, START + i * STEP + DELAY, imu(True, i))
    return path


def write_mcap(folder: Path, compression: CompressionType) -> Path:
    """A bag as ROS 2 writes it, with checksums, in chunks of 40 messages."""
    path = folder / f"{compression.name}.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=40 * 370, compression=compression)
        writer.start(profile="ros2")
        definition = typestore(False).generate_msgdef(IMU, ros_version=2)[0]
        schema = writer.register_schema(name="sensor_msgs/msg/Imu", encoding="ros2msg", data=definition.encode())
        channel = writer.register_channel(topic="/imu", message_encoding="cdr", schema_id=schema)
        for i in range(COUNT):
            received = START + i * STEP + DELAY
            writer.add_message(channel, log_time=received, publish_time=received, data=imu(False, i))
        writer.finish()
    return path


def write_sqlite(folder: Path) -> Path:
    with Writer2(folder / "bag", version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        connection = writer.add_connection("/imu", IMU, typestore=typestore(False))
        for i in range(COUNT):
            writer.write(connection, START + i * STEP + DELAY, imu(False, i))
    (file,) = (folder / "bag").glob("*.db3")
    return file.rename(folder / "bag.db3")


@pytest.fixture(scope="module")
def bags(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("bags")
    return {
        "ros1": write_ros1(folder, ""),
        "bz2": write_ros1(folder, "bz2"),
        "lz4": write_ros1(folder, "lz4"),
        "mcap": write_mcap(folder, CompressionType.NONE),
        "mcap_zstd": write_mcap(folder, CompressionType.ZSTD),
        "mcap_lz4": write_mcap(folder, CompressionType.LZ4),
        "sqlite": write_sqlite(folder),
    }


KINDS = ("ros1", "bz2", "lz4", "mcap", "mcap_zstd", "mcap_lz4", "sqlite")


def readings(folder: Path, content: bytes) -> list[int]:
    """Import the damaged bag and return which of the messages came through, each of which must be what was sent."""
    path = folder / "damaged"
    path.write_bytes(content)
    messages = run(folder, MAPPING, path)["GYRO_0"]
    numbers = [round((one.utime * 1000 - START) / STEP) for one in messages]
    assert [one.yaw_rate for one in messages] == [0.25 * i for i in numbers]
    return numbers


@pytest.mark.parametrize("kind", KINDS)
def test_an_intact_bag_comes_through_whole(
    tmp_path: Path, bags: dict[str, Path], kind: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert readings(tmp_path, bags[kind].read_bytes()) == list(range(COUNT))
    assert "damaged:" not in capsys.readouterr().out


@pytest.mark.parametrize("kind", KINDS)
def test_a_bag_that_was_cut_off_gives_what_is_before_the_cut(
    tmp_path: Path, bags: dict[str, Path], kind: str, capsys: pytest.CaptureFixture[str]
) -> None:
    content = bags[kind].read_bytes()
    cut = round(0.6 * len(content))
    numbers = readings(tmp_path, content[:cut])
    before = len(numbers) if kind != "sqlite" else COUNT // 2  # SQLite writes its pages nearly in the rows' order
    assert numbers[:before] == list(range(before))
    assert len(numbers) >= COUNT // 2
    assert "is truncated or damaged: " in capsys.readouterr().out


@pytest.mark.parametrize("kind", KINDS)
def test_a_zeroed_block_costs_only_what_it_hit(
    tmp_path: Path, bags: dict[str, Path], kind: str, capsys: pytest.CaptureFixture[str]
) -> None:
    content = bytearray(bags[kind].read_bytes())
    middle = len(content) // 2
    size = 9000 if kind == "sqlite" else 400  # pages have no checksums: a damaged row in an intact one is not noticed
    content[middle : middle + size] = bytes(size)
    numbers = readings(tmp_path, bytes(content))
    assert COUNT - 120 <= len(numbers) < COUNT
    assert {0, COUNT - 1} <= set(numbers)
    assert "is truncated or damaged: " in capsys.readouterr().out


@pytest.mark.parametrize("kind", ["ros1", "mcap"])
def test_a_chunks_wrong_length_does_not_hide_the_chunks_behind_it(
    tmp_path: Path, bags: dict[str, Path], kind: str
) -> None:
    content = bytearray(bags[kind].read_bytes())
    if kind == "ros1":
        chunk = content.index(b"op=\x05", len(content) // 3)
        place = content.index(b"op=\x02", chunk) - 12  # the data's length is before the first record in the chunk
        places = [match.end() for match in re.finditer(rb"size=....", bytes(content[:place]), re.DOTALL)]
        place = places[-1]
    else:
        place = content.index(b"\x06", content.index(b"\x07", len(content) // 3)) + 1
    content[place + 2] ^= 0x0F
    numbers = readings(tmp_path, bytes(content))
    assert len(numbers) >= COUNT - 160
    assert {0, COUNT - 1} <= set(numbers)


def test_a_chunk_that_fails_its_checksum_is_not_believed(
    tmp_path: Path, bags: dict[str, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    content = bytearray(bags["mcap"].read_bytes())
    content[content.index(imu(False, 200)) + 250] ^= 0x40
    numbers = readings(tmp_path, bytes(content))
    assert 200 not in numbers
    assert len(numbers) >= COUNT - 50
    assert "a chunk that fails its checksum" in capsys.readouterr().out


def test_topics_are_known_even_if_the_first_chunk_is_damaged_and_the_end_is_missing(
    tmp_path: Path, bags: dict[str, Path]
) -> None:
    content = bytearray(bags["mcap"].read_bytes())
    content[content.index(imu(False, 5)) + 250] ^= 0x40
    numbers = readings(tmp_path, bytes(content[: round(0.9 * len(content))]))
    assert COUNT // 2 < len(numbers) < COUNT


def test_an_error_about_a_damaged_bag_says_that_it_is_damaged(tmp_path: Path, bags: dict[str, Path]) -> None:
    with pytest.raises(CommandError, match=r"/imu: no such topic; .*damaged is truncated or damaged: .*it has no end"):
        readings(tmp_path, bags["mcap"].read_bytes()[:60])


def test_a_bag_whose_recorder_was_killed_is_read(
    tmp_path: Path, bags: dict[str, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    content = bags["ros1"].read_bytes()
    place = content.index(b"index_pos=") + len(b"index_pos=")
    without_index = content[:place] + bytes(8) + content[place + 8 : content.rindex(b"op=\x04")]
    assert readings(tmp_path, without_index) == list(range(COUNT))
    assert "it was never closed by its recorder" in capsys.readouterr().out


def test_messages_in_the_journal_of_a_killed_recorder_are_read_and_the_bag_is_left_as_it_was(
    tmp_path: Path, bags: dict[str, Path]
) -> None:
    whole, folder = tmp_path / "whole.db3", tmp_path / "killed"
    folder.mkdir()
    whole.write_bytes(bags["sqlite"].read_bytes())
    with closing(sqlite3.connect(whole)) as recorder:
        recorder.execute("PRAGMA journal_mode=WAL")
        recorder.execute(
            "INSERT INTO messages(topic_id, timestamp, data) SELECT topic_id, timestamp, ? FROM messages WHERE id = 1",
            (imu(False, COUNT),),
        )
        recorder.commit()
        for name in ("whole.db3", "whole.db3-wal"):
            (folder / name).write_bytes((tmp_path / name).read_bytes())
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    assert len(run(tmp_path, MAPPING, folder)["GYRO_0"]) == COUNT + 1
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


def outcome(path: Path, folder: Path) -> Source | str:
    """Read a bag as cmr-import does; its errors are the only ones allowed."""
    mapping_file = folder / "robot.yaml"
    mapping_file.write_text(yaml.safe_dump(MAPPING))
    try:
        return read_bag(load(str(mapping_file)), path)
    except SourceError as error:
        return str(error)


Damage = list[tuple[float, bytes]]


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=12, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    damage=st.lists(st.tuples(st.floats(0, 1), st.binary(min_size=1, max_size=40)), max_size=4),
    kept=st.one_of(st.just(1.0), st.floats(0, 1)),
)
@example(damage=[(0.0, b"")], kept=0.0)
def test_any_damage_ends_in_rows_or_one_sentence(
    bags: dict[str, Path], tmp_path: Path, kind: str, damage: Damage, kept: float
) -> None:
    content = bytearray(bags[kind].read_bytes())
    for share, replacement in damage:
        place = int(share * len(content))
        content[place : place + len(replacement)] = replacement
    path = tmp_path / "any"
    path.write_bytes(content[: round(kept * len(content))])
    result = outcome(path, tmp_path)
    if isinstance(result, str):
        assert result
        assert "\n" not in result
    else:
        assert 0 < len(result.tables["/imu"].utime) <= COUNT + 1


MAGICS = [b"#ROSBAG V2.0\n", b"\x89MCAP0\r\n", b"SQLite format 3\0", b""]


@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
@given(magic=st.sampled_from(MAGICS), rest=st.binary(max_size=200))
def test_any_bytes_are_refused_in_one_sentence(tmp_path: Path, magic: bytes, rest: bytes) -> None:
    path = tmp_path / "any"
    path.write_bytes(magic + rest)
    result = outcome(path, tmp_path)
    assert isinstance(result, str)
    assert "\n" not in result


def test_a_file_that_is_no_bag_is_said(tmp_path: Path) -> None:
    (tmp_path / "x.bag").write_bytes(b"hello, robot")
    with pytest.raises(CommandError, match=r"x\.bag: is no ROS bag \(\.bag, \.db3\) and no MCAP file; it begins with"):
        run(tmp_path, MAPPING, tmp_path / "x.bag")


def test_a_message_that_does_not_decode_is_counted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "x.bag"
    with Writer1(path) as writer:
        connection: Any = writer.add_connection("/imu", IMU, typestore=typestore(True))
        for i, data in enumerate((imu(True, 0), imu(True, 1)[:-8], b"", imu(True, 3), b"\xff" * 400)):
            writer.write(connection, START + i, data)
    assert len(run(tmp_path, MAPPING, path)["GYRO_0"]) == 2
    assert "/imu: 3 x message that does not decode" in capsys.readouterr().out
