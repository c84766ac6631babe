"""What recordings hold packed is unpacked as far as a recording can be: a bomb of 0.6 MB holds 600 MB of nothing."""

import bz2
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO

FREE_BYTES = 1 << 26  # that any file may hold unpacked ...
MOST_PER_BYTE = 100  # ... and a larger one for each byte packed; of measured data it is 2 to 50
LARGEST_RECORD = 1 << 28  # bytes that are read, or unpacked, at once; recorders make chunks of some MB
PIECE_BYTES = 1 << 16  # that are unpacked at a time: all of it that is before damage is kept
TOO_MUCH = (
    "{path}: holds more than {most:.0f} MB unpacked, {times} times its size or more, as measured data never does. If "
    "it is meant so, unpack it ({tool}) and import that"
)


def most_unpacked(packed: int) -> int:
    """Return how much a file of so many bytes may hold [bytes]."""
    return max(FREE_BYTES, MOST_PER_BYTE * packed)


def too_much(path: Path, packed: int, tool: str) -> str:
    """Return the sentence about a file of so many bytes that holds too much."""
    return TOO_MUCH.format(path=path, most=most_unpacked(packed) / 1e6, times=MOST_PER_BYTE, tool=tool)


def decompress(compression: str, data: bytes, most: int = LARGEST_RECORD) -> bytes:
    """Return what can be decompressed, one byte more than `most` at most: of damaged data that before the damage."""
    if compression in ("", "none"):
        return data
    unpacked = bytearray()
    try:
        for piece in _PIECES[compression](data, most + 1):
            unpacked += piece
            if len(unpacked) > most:
                break
    except Exception:  # the libraries' errors have no base in common; whatever they are, the data is damaged here
        pass
    return bytes(unpacked[: most + 1])


def copy_unpacked(source: BinaryIO, sink: BinaryIO, most: int) -> bool:
    """Write what is compressed by Zstandard, `most` bytes and some more; return whether it is no more than that."""
    import zstandard

    reader = zstandard.ZstdDecompressor().stream_reader(source)
    while piece := reader.read(PIECE_BYTES):
        sink.write(piece)
        if sink.tell() > most:
            return False
    return True


def _of_zstandard(data: bytes, most: int) -> Iterator[bytes]:
    import zstandard

    reader = zstandard.ZstdDecompressor().stream_reader(data)
    while piece := reader.read(min(PIECE_BYTES, most)):
        yield piece


def _of_bz2(data: bytes, most: int) -> Iterator[bytes]:
    decompressor = bz2.BZ2Decompressor()
    yield from _bounded(decompressor.decompress, lambda: decompressor.eof or decompressor.needs_input, data, most)


def _of_lz4(data: bytes, most: int) -> Iterator[bytes]:
    import lz4.frame  # type: ignore[import-untyped]

    decompressor = lz4.frame.LZ4FrameDecompressor()
    yield from _bounded(decompressor.decompress, lambda: decompressor.eof or decompressor.needs_input, data, most)


def _bounded(
    decompress_some: Callable[[bytes, int], bytes], has_enough: Callable[[], bool], data: bytes, most: int
) -> Iterator[bytes]:
    """Yield what a decompressor makes of the data piece by piece, never more than `most` bytes at once."""
    for start in range(0, len(data), PIECE_BYTES):
        yield decompress_some(data[start : start + PIECE_BYTES], most)
        while not has_enough():
            yield decompress_some(b"", most)


_PIECES: dict[str, Callable[[bytes, int], Iterator[bytes]]] = {
    "bz2": _of_bz2,
    "lz4": _of_lz4,
    "zstd": _of_zstandard,
}
