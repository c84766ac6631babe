"""Unpack compressed recordings up to a limit: a decompression bomb of 0.6 MB may expand to 600 MB."""

import bz2
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO

FREE_BYTES = 1 << 26  # unpacked, allowed for any file ...
MOST_PER_BYTE = 100  # ... and per packed byte for larger files; measured data have a ratio of 2 to 50
LARGEST_RECORD = 1 << 28  # bytes read or unpacked at once; recorders write chunks of some MB
PIECE_BYTES = 1 << 16  # unpacked at a time: everything before damage is kept
TOO_MUCH = (
    "{path}: holds more than {most:.0f} MB unpacked, {times} times its size or more, as measured data never does. If "
    "it is meant so, unpack it ({tool}) and import that"
)


def most_unpacked(packed: int) -> int:
    """Return the largest allowed unpacked size of a file of this size [bytes]."""
    return max(FREE_BYTES, MOST_PER_BYTE * packed)


def too_much(path: Path, packed: int, tool: str) -> str:
    """Return the error message for a file that is too large when unpacked."""
    return TOO_MUCH.format(path=path, most=most_unpacked(packed) / 1e6, times=MOST_PER_BYTE, tool=tool)


def decompress(compression: str, data: bytes, most: int = LARGEST_RECORD) -> bytes:
    """Return the decompressed data, at most one byte more than `most`; of damaged data, the part before the damage."""
    if compression in ("", "none"):
        return data
    unpacked = bytearray()
    try:
        for piece in _PIECES[compression](data, most + 1):
            unpacked += piece
            if len(unpacked) > most:
                break
    except Exception:  # the libraries' errors have no common base; any of them means damaged data
        pass
    return bytes(unpacked[: most + 1])


def copy_unpacked(source: BinaryIO, sink: BinaryIO, most: int) -> bool:
    """Decompress with Zstandard, writing a little more than `most` bytes at most; return whether that was
    everything.
    """
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
    """Yield decompressed data piece by piece, never more than `most` bytes at once."""
    for start in range(0, len(data), PIECE_BYTES):
        yield decompress_some(data[start : start + PIECE_BYTES], most)
        while not has_enough():
            yield decompress_some(b"", most)


_PIECES: dict[str, Callable[[bytes, int], Iterator[bytes]]] = {
    "bz2": _of_bz2,
    "lz4": _of_lz4,
    "zstd": _of_zstandard,
}
