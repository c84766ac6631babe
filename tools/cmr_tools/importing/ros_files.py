"""Find the files of a bag, and the reader for each: by its first bytes, since file names are unreliable."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from cmr.files import open_regular
from cmr.litter import temporary_folder
from cmr_tools.importing import ros_bag1, ros_mcap, ros_sqlite
from cmr_tools.importing.ros_records import BagError, BagReader
from cmr_tools.importing.unpacking import copy_unpacked, most_unpacked, too_much

ZSTANDARD_SUFFIX = ".zstd"  # of files that rosbag2 compressed as a whole
SUFFIXES = (".bag", ".active", ".mcap", ".db3")

_READERS: tuple[tuple[bytes, type[BagReader]], ...] = (
    (ros_bag1.MAGIC, ros_bag1.Bag1Reader),
    (ros_mcap.MAGIC, ros_mcap.McapReader),
    (ros_sqlite.MAGIC, ros_sqlite.SqliteReader),
)


def files_of(path: Path) -> list[Path]:
    """Return the files of a recording: itself, or for a folder all files of bags, in the order of their names.

    Raises BagError for a folder without any, OSError if it cannot be read.
    """
    if not path.is_dir():
        return [path]
    present = sorted(file for file in path.iterdir() if file.is_file())
    files = [file for file in present if file.suffix in SUFFIXES]
    files += [
        file
        for file in present
        if file.suffix == ZSTANDARD_SUFFIX
        and file.with_suffix("").suffix in SUFFIXES
        and file.with_suffix("") not in files
    ]
    if not files:
        inside = sorted(path.iterdir())[:10]
        names = ", ".join(f"{one.name}/" if one.is_dir() else one.name for one in inside) or "nothing"
        raise BagError(f"{path}: has no file that ends in .bag, .mcap or .db3; there is {names}")
    return files


@contextmanager
def opened(path: Path, wanted: frozenset[str]) -> Iterator[BagReader]:
    """Open one file with its reader for the wanted topics; a file that is compressed as a whole is unpacked.

    Raises BagError if it is not a bag, OSError if it cannot be read.
    """
    if path.suffix != ZSTANDARD_SUFFIX:
        yield _reader_class(path)(path, wanted)
        return
    with temporary_folder("cmr-import") as folder:
        unpacked = folder / path.stem
        is_whole = _unpack(path, unpacked)
        reader = _reader_class(unpacked)(unpacked, wanted)
        if not is_whole:
            reader.fault("its compression breaks off")
        yield reader


def _reader_class(path: Path) -> type[BagReader]:
    with open_regular(path) as stream:
        begin = stream.read(16)
    for magic, reader in _READERS:
        if begin.startswith(magic):
            return reader
    raise BagError(f"{path}: is no ROS bag (.bag, .db3) and no MCAP file; it begins with {begin[:8]!r}")


def _unpack(path: Path, unpacked: Path) -> bool:
    """Unpack as much as possible; return whether that is all. Raises BagError if it is too large."""
    import zstandard

    packed = path.stat().st_size
    with open_regular(path) as source, unpacked.open("wb") as sink:
        try:
            if not copy_unpacked(source, sink, most_unpacked(packed)):
                raise BagError(too_much(path, packed, "zstd -d"))
        except zstandard.ZstdError:
            return False
    return True
