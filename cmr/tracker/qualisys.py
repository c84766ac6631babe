"""Qualisys Track Manager, over its real-time protocol (QTM RT 1.19): all frames of the bodies, with time stamps.

The package `qtm_rt` splits the stream into packets. Its own connection runs in asyncio, and it takes 0.5 ms to parse 50
bodies, so both are done here. The names of bodies are in QTM's settings.
"""

import math
import struct
import time
import xml.etree.ElementTree as ET
from collections.abc import Sequence

import numpy as np
from qtm_rt.packet import QRTComponentType, QRTPacket, QRTPacketType
from qtm_rt.receiver import Receiver

from cmr.tracker.frames import Sample
from cmr.tracker.profile import Tracker
from cmr.tracker.source import RETRY, SILENT, Clock, Stream

PORT = 22223  # little-endian
VERSION = "1.19"
COMMAND = 1
HEADER = struct.Struct("<II")
BODIES = struct.Struct("<iHH")  # count, drop rate, out-of-sync rate
BODY = struct.Struct("<12f")  # position [mm], and the matrix's columns one after another
DATA, DATA_HEADER = 3, struct.Struct("<qII")  # time stamp [us], number, components
LARGEST_PACKET, LARGEST_XML = 16_000_000, 4_000_000  # bytes
MOST_COMPONENTS = 64
MOST = 10_000  # bodies
NOWHERE = (math.nan,) * 4


class Qualisys:
    """A QTM server. Its time stamps count from the start of the measurement."""

    uncertainty = "the time that QTM needs for a frame and the network for its way, beyond the profile's lag"

    def __init__(self, tracker: Tracker, clock: Clock = time.monotonic_ns) -> None:
        self.problem = ""
        self._clock = clock
        self._stream = Stream(tracker.server, tracker.port or PORT, clock)
        self._origin = f"{tracker.server}:{tracker.port or PORT}"
        self._names: tuple[str, ...] = ()
        self._said = ""  # problem reported by QTM
        self._asked = -1e9
        self._waiting = b""
        self._arrival = 0
        self._samples: list[Sample] = []
        self._begin()

    def filenos(self) -> list[int]:
        """Return the socket to wait on."""
        return self._stream.filenos()

    def read(self) -> list[Sample]:
        """Return the frames received."""
        data = self._stream.receive()
        self._arrival = self._clock()
        try:
            for packet in self._packets(data):
                self._receiver.data_received(packet)
        except (ValueError, struct.error, ET.ParseError) as error:
            self._stream.drop(f"it sent what is not QTM's protocol ({error})")
            self._begin()
        samples, self._samples = self._samples, []
        return samples

    def tend(self, now: float) -> None:
        """Connect, request the names of bodies, and request frames while none arrive."""
        if self._stream.is_open and now - self._stream.heard > SILENT and now - self._asked > SILENT:
            self._ask(now)
        if self._stream.connect(now):
            self._begin()
            self._command(f"version {VERSION}")
            self._ask(now)
        self.problem = self._stream.problem or self._said

    def close(self) -> None:
        """Close the connection."""
        self._stream.close()

    def _packets(self, data: bytes) -> list[bytes]:
        """Return the complete packets; `qtm_rt` would loop for ever on one of size zero or with a huge number of
        parts.
        """
        self._waiting += data
        at, packets = 0, []
        while len(self._waiting) - at >= HEADER.size:
            size, kind = HEADER.unpack_from(self._waiting, at)
            if not HEADER.size <= size <= LARGEST_PACKET:
                raise ValueError(f"a packet of {size} bytes")
            if len(self._waiting) - at < size:
                break
            if kind == DATA and DATA_HEADER.unpack_from(self._waiting, at + HEADER.size)[2] > MOST_COMPONENTS:
                raise ValueError("a frame of countless parts")
            packets.append(self._waiting[at : at + size])
            at += size
        self._waiting = self._waiting[at:]
        return packets

    def _begin(self) -> None:
        """Start reading at the beginning of a packet."""
        self._waiting = b""
        kinds = QRTPacketType
        self._receiver = Receiver(
            {
                kinds.PacketError: self._on_error,
                kinds.PacketCommand: lambda _: None,
                kinds.PacketXML: self._on_settings,
                kinds.PacketData: self._on_data,
                kinds.PacketNoMoreData: self._on_no_more,
                kinds.PacketEvent: lambda _: None,
            }
        )

    def _ask(self, now: float) -> None:
        self._asked = now
        self._command("getparameters 6d")
        self._command("streamframes allframes 6d")

    def _command(self, text: str) -> None:
        data = text.encode() + b"\0"
        self._stream.send(HEADER.pack(HEADER.size + len(data), COMMAND) + data)

    def _on_error(self, text: bytes) -> None:
        self._said = f"QTM says: {text.decode(errors='replace')}."

    def _on_no_more(self, _: object) -> None:
        self._said = "QTM does not measure: start a measurement (New, or RT output from file) there."

    def _on_settings(self, xml: bytes) -> None:
        """Store the names of bodies from the 6DOF settings."""
        if len(xml) > LARGEST_XML or b"<!" in xml:  # no entities: QTM sends none
            raise ValueError("settings with entities, or too large")
        root = ET.fromstring(xml.decode())
        self._names = tuple(body.findtext("Name") or body.get("Name") or "" for body in root.iterfind(".//The_6D/Body"))

    def _on_data(self, packet: QRTPacket) -> None:
        at = packet.components.get(QRTComponentType.Component6d)
        if at is None:
            return
        self._said = ""
        count, _, _ = BODIES.unpack_from(packet.data, at)
        if not 0 <= count <= MOST:
            raise ValueError(f"a frame of {count} bodies")
        bodies = list(BODY.iter_unpack(packet.data[at + BODIES.size : at + BODIES.size + count * BODY.size]))
        if len(bodies) < count:
            raise ValueError(f"a frame of {count} bodies that ends before")
        if count != len(self._names):
            if self._clock() / 1e9 - self._asked > RETRY:
                self._asked = self._clock() / 1e9
                self._command("getparameters 6d")
            return
        seen = [k for k, body in enumerate(bodies) if all(map(math.isfinite, body[:3]))]
        names = self._names if len(seen) == count else tuple(self._names[k] for k in seen)
        positions = np.array([bodies[k][:3] for k in seen], np.float64).reshape(-1, 3)
        quaternions = np.array([quaternion_of(bodies[k][3:]) for k in seen], np.float64).reshape(-1, 4)
        measured = packet.timestamp / 1e6
        self._samples.append(Sample(self._arrival, measured, measured, names, positions, quaternions, self._origin))


def quaternion_of(columns: Sequence[float]) -> tuple[float, float, float, float]:
    """Return the quaternion (x, y, z, w) of a rotation matrix, given as 9 numbers, column by column.

    The largest of the four components comes from the diagonal, the others from it (Shepperd, 1978). The result is NaN
    if the numbers are not a rotation. For few bodies this is faster than NumPy.
    """
    xx, yx, zx, xy, yy, zy, xz, yz, zz = columns
    trace = xx + yy + zz
    largest = max(xx, yy, zz, trace)
    if largest == trace:
        x, y, z, w = zy - yz, xz - zx, yx - xy, 1.0 + trace
    elif largest == xx:
        x, y, z, w = 1.0 + 2.0 * xx - trace, xy + yx, xz + zx, zy - yz
    elif largest == yy:
        x, y, z, w = xy + yx, 1.0 + 2.0 * yy - trace, yz + zy, xz - zx
    else:
        x, y, z, w = xz + zx, yz + zy, 1.0 + 2.0 * zz - trace, yx - xy
    size = math.sqrt(x * x + y * y + z * z + w * w)
    return (x / size, y / size, z / size, w / size) if size > 0.0 else NOWHERE
