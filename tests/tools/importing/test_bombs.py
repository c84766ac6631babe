"""Recordings that hold a thousand times their size are refused or passed over, with the file and what to do."""

import bz2
import gzip
import io
import os
import struct
import time
import tracemalloc
from pathlib import Path

import lz4.frame  # type: ignore[import-untyped]
import pytest
import zstandard
from mcap.writer import CompressionType

from cmr.cli.errors import CommandError
from cmr.recordings.events import EventReader
from cmr_tools.importing import unpacking
from cmr_tools.importing.import_log import main
from cmr_tools.importing.ros_files import opened
from cmr_tools.importing.ros_records import BagError
from cmr_tools.importing.unpacking import decompress
from tests.tools.importing.import_bench import CSV_HEAD, POSE, write_csv, write_mapping
from tests.tools.importing.test_ros_damage import COUNT, write_mcap, write_ros1

MAPPING = CSV_HEAD | {"pose": POSE}
NOTHING = bytes(1 << 22)
COMPRESSORS = {"bz2": bz2.compress, "lz4": lz4.frame.compress, "zstd": zstandard.ZstdCompressor().compress}


def refused(folder: Path, recording: Path) -> str:
    with pytest.raises(CommandError) as error:
        main([write_mapping(folder, MAPPING), str(recording), "--out", str(folder / "run.lcm")])
    return str(error.value)


def test_a_packed_table_that_holds_too_much_is_refused_before_its_rows_are_read(tmp_path: Path) -> None:
    bomb = tmp_path / "bomb.csv.gz"
    with gzip.open(bomb, "wb") as stream:
        stream.write(b"t,x,y,theta\n")
        for _ in range(100):
            stream.write(b"1,1,1,1\n" * 125_000)
    began = time.process_time()
    words = refused(tmp_path, bomb)
    assert time.process_time() - began < 3.0  # of its 12 million rows it takes half a minute
    assert words.startswith(f"{bomb}: holds more than 67 MB unpacked")
    assert words.endswith("unpack it (gunzip) and import that")


def test_a_table_without_ends_of_lines_is_read_until_there(tmp_path: Path) -> None:
    recording = write_csv(tmp_path, "t,x,y,theta\n" + "1" * 3_000_000)
    assert "line 2 has 1000000 characters or more" in refused(tmp_path, recording)


def test_a_pipe_is_no_recording(tmp_path: Path) -> None:
    pipe = tmp_path / "recording.csv"
    os.mkfifo(pipe)
    assert "it is no regular file" in refused(tmp_path, pipe)


@pytest.mark.parametrize("compression", COMPRESSORS)
def test_no_more_is_unpacked_than_was_asked_for(compression: str) -> None:
    packed = COMPRESSORS[compression](NOTHING * 16)
    tracemalloc.start()
    assert len(decompress(compression, packed, 100_000)) == 100_001
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < len(NOTHING)
    assert decompress(compression, COMPRESSORS[compression](NOTHING), 1 << 23) == NOTHING


@pytest.mark.parametrize("kind", ["bz2", "lz4", "zstd"])
def test_a_chunk_that_holds_too_much_is_passed_over_and_said(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bag = write_mcap(tmp_path, CompressionType[kind.upper()]) if kind == "zstd" else write_ros1(tmp_path, kind)
    data = COMPRESSORS[kind](NOTHING)
    if kind == "zstd":
        head = struct.pack("<QQQI", 0, 0, len(NOTHING), 0) + struct.pack("<I", 4) + b"zstd"
        content = head + struct.pack("<Q", len(data)) + data
        content = bag.read_bytes()[:8] + struct.pack("<BQ", 6, len(content)) + content + bag.read_bytes()[8:]
    else:
        fields = [b"op=\x05", b"compression=" + kind.encode(), b"size=" + struct.pack("<I", len(NOTHING))]
        head = b"".join(struct.pack("<I", len(field)) + field for field in fields)
        record = struct.pack("<I", len(head)) + head + struct.pack("<I", len(data)) + data
        content = bag.read_bytes() + record
    bag.write_bytes(content)
    for module in ("ros_records", "ros_bag1", "ros_mcap"):
        monkeypatch.setattr(f"cmr_tools.importing.{module}.LARGEST_RECORD", 1 << 20)
    with opened(bag, frozenset({"/imu"})) as reader:
        assert len(list(reader)) == COUNT
    assert "a record of more than 1 MB, which is the most that is read at once" in reader.sentence()


def test_a_bag_that_was_packed_as_a_whole_is_not_unpacked_without_bounds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(unpacking, "FREE_BYTES", 1 << 20)
    bomb = tmp_path / "bomb.mcap.zstd"
    bomb.write_bytes(COMPRESSORS["zstd"](NOTHING))
    with (
        pytest.raises(BagError, match=r"bomb\.mcap\.zstd: holds more than 1 MB unpacked.*zstd -d"),
        opened(bomb, frozenset()),
    ):
        pass
    sink = io.BytesIO()
    assert not unpacking.copy_unpacked(io.BytesIO(bomb.read_bytes()), sink, 1000)
    assert len(sink.getvalue()) < len(NOTHING) // 10


def test_a_pipe_is_no_log(tmp_path: Path) -> None:
    pipe = tmp_path / "run.lcm"
    os.mkfifo(pipe)
    with pytest.raises(OSError, match="it is no regular file"):
        EventReader(pipe)
