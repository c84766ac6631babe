"""Detect poses that other programs publish. The kernel drops this program's own poses before they wake a thread.

A subscription would deliver them: with 50 robots at 240 Hz, 12,000 times a second. So this module reads the multicast
group in parallel to LCM, with a filter on the socket (BPF, as in Linux' Documentation/networking/filter.rst; a short
message of LCM as in its "UDP Multicast Protocol Description").
"""

import contextlib
import ctypes
import os
import select
import socket
import struct
import time

from cmr.bus.bus import Bus
from cmr.bus.inbox import Inbox
from cmr.bus.messages import make
from cmr.bus.preflight import SELF_TEST_SECONDS, BusError, parse_udpm, verifier_of
from cmr.bus.streams import POSE, SELF_TEST, Stream
from cmr.msg import pose_xyt_t

MAGIC, NAME_AT = b"LC02", 8  # a short message: these bytes, its number, the channel's name with a zero, the message
TRIAL = Stream(SELF_TEST, pose_xyt_t, False, None, "any program that tries the bus")
LARGEST = 1 << 16  # bytes of a packet
MOST = 64  # packets taken at once: a flood must not delay the process's own poses
Address = tuple[str, int]
NOBODY: Address = ("0.0.0.0", 0)

SO_ATTACH_FILTER = 26
INSTRUCTION = struct.Struct("=HBBI")  # code, how far to jump if true and if false, operand
LOAD_WORD, LOAD_HALF, LOAD_BYTE, JUMP_IF_EQUAL, RETURN = 0x20, 0x28, 0x30, 0x15, 0x06
UDP_HEADER = 8  # bytes before the payload; the sender's port is in the first two
SENDERS_ADDRESS = 0xFFF00000 + 12  # in the header of the network's packet


class Overheard:
    """Receives poses of all programs but this one, from which `bus` publishes; on a bus without multicast, none.

    Raises BusError if a published message does not come back.
    """

    def __init__(self, bus: Bus) -> None:
        self._inbox = Inbox(verifier_of(bus.url))
        self._own = NOBODY
        self._socket = joined(bus.url) if bus.url.startswith("udpm:") else None
        if self._socket is not None:
            _attach(self._socket, _filter(SELF_TEST))
            self._own = _own_address(self._socket, bus)
            _attach(self._socket, _filter(f"{POSE.name}_", self._own))

    def robots(self) -> set[int]:
        """Return the robots with poses from other programs since the last call."""
        for _ in range(MOST if self._socket is not None else 0):
            assert self._socket is not None
            try:
                packet, sender = self._socket.recvfrom(LARGEST)
            except OSError:  # nothing more
                break
            message = split(packet)
            if message is not None and sender != self._own:
                self._inbox.take(*message)
        came = (received.message_of(POSE) for received in self._inbox.emptied())
        return {int(pose.robot_id) for pose in came if pose is not None}

    def close(self) -> None:
        """Close the socket."""
        if self._socket is not None:
            self._socket.close()


def joined(url: str) -> socket.socket:
    """Return a non-blocking socket that receives the packets of the bus at a URL, as LCM's own does."""
    multicast = parse_udpm(url)
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    made.setblocking(False)
    made.bind((multicast.group, multicast.port))
    membership = socket.inet_aton(multicast.group) + socket.inet_aton("0.0.0.0")
    made.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership)
    return made


def split(packet: bytes) -> tuple[str, bytes] | None:
    """Return the channel and the bytes of a short message of LCM; None for another packet."""
    name, zero, message = packet[NAME_AT:].partition(b"\0")
    return (name.decode(errors="replace"), message) if packet.startswith(MAGIC) and zero else None


def _own_address(listening: socket.socket, bus: Bus) -> Address:
    """Return the address from which messages of a bus are sent, by sending a unique one."""
    trial = make(pose_xyt_t, utime=int.from_bytes(os.urandom(7), "big"), robot_id=0, x=0.0, y=0.0, theta=0.0)
    data, deadline = trial.encode(), time.monotonic() + SELF_TEST_SECONDS
    bus.publish(TRIAL, trial)
    while (rest := deadline - time.monotonic()) > 0.0:
        if select.select([listening], [], [], rest)[0]:
            packet, (address, port) = listening.recvfrom(LARGEST)
            if data in packet:
                return address, port
    raise BusError(f"A message sent on {bus.url!r} did not come back. Is it flooded? Try again.")


def _filter(channel: str, own: Address = NOBODY) -> bytes:
    """Return a BPF program that accepts packets of others whose channel begins like this; its last line drops a
    packet.
    """
    wanted = [(UDP_HEADER + k, byte) for k, byte in enumerate(MAGIC)]
    wanted += [(UDP_HEADER + NAME_AT + k, byte) for k, byte in enumerate(channel.encode())]
    program = [
        (LOAD_WORD, 0, 0, SENDERS_ADDRESS),
        (JUMP_IF_EQUAL, 0, 2, int.from_bytes(socket.inet_aton(own[0]), "big")),
        (LOAD_HALF, 0, 0, 0),
        (JUMP_IF_EQUAL, 2 * len(wanted) + 1, 0, own[1]),
    ]
    for k, (at, byte) in enumerate(wanted):
        program += [(LOAD_BYTE, 0, 0, at), (JUMP_IF_EQUAL, 0, 2 * (len(wanted) - k) - 1, byte)]
    program += [(RETURN, 0, 0, LARGEST), (RETURN, 0, 0, 0)]
    return b"".join(INSTRUCTION.pack(*one) for one in program)


def _attach(listening: socket.socket, program: bytes) -> None:
    """Attach a filter to the socket; on systems without such filters, all packets are received."""
    memory = ctypes.create_string_buffer(program, len(program))
    described = struct.pack("@HP", len(program) // INSTRUCTION.size, ctypes.addressof(memory))
    with contextlib.suppress(OSError):
        listening.setsockopt(socket.SOL_SOCKET, SO_ATTACH_FILTER, described)
