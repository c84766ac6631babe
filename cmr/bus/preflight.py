"""Check the bus and explain failures: LCM itself says only "Couldn't create LCM", or nothing."""

import ipaddress
import os
import select
import socket
import struct
import time
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import parse_qsl, urlsplit

import lcm

from cmr.bus.keys import key_in_use
from cmr.bus.signing import Verifier
from cmr.bus.streams import SELF_TEST
from cmr.cli import configuration
from cmr.cli.configuration import DEFAULT_URL
from cmr.cli.errors import ExpectedError

LARGEST_TTL = 255  # one byte in the IP header
LARGEST_BUFFER = 2**31 - 1  # bytes; the int that LCM and the kernel take
SELF_TEST_SECONDS = 1.0  # the loopback takes a tenth of a millisecond; more is a fault, not load


class BusError(ExpectedError):
    """The bus cannot be used; the text says why and what to do."""


@dataclass
class Multicast:
    """A udpm URL in parts; defaults are LCM's own."""

    group: str = "239.255.76.67"
    port: int = 7667
    ttl: int = 0
    recv_buf_size: int = 0
    options: dict[str, str] = field(default_factory=dict)


def resolve_url(url: str | None) -> str:
    """Return `url` if given, else that of the environment or configuration file, else one limited to this host."""
    return url or configuration.lcm_url() or DEFAULT_URL


def parse_udpm(url: str) -> Multicast:
    """Return the parts of a udpm URL.

    Raises BusError naming the part that is wrong.
    """
    try:
        parts = urlsplit(url)
        options = dict(parse_qsl(parts.query))
        multicast = Multicast(
            group=parts.hostname or Multicast.group,
            port=parts.port or Multicast.port,
            ttl=_whole_number(options, "ttl", LARGEST_TTL),
            recv_buf_size=_whole_number(options, "recv_buf_size", LARGEST_BUFFER),
            options=options,
        )
        is_multicast = ipaddress.IPv4Address(multicast.group).is_multicast
    except ValueError as error:
        raise _unreadable(url, error) from error
    if not is_multicast:
        raise BusError(f"{multicast.group} in {url!r} is not a multicast address. Use one in 239.0.0.0/8.")
    return multicast


def _whole_number(options: dict[str, str], name: str, largest: int) -> int:
    text = options.get(name, "0")
    if not text.isdecimal() or int(text) > largest:
        raise ValueError(f"{name} must be a whole number of 0 to {largest}, not {text!r}")
    return int(text)


def _unreadable(url: str, error: ValueError) -> BusError:
    return BusError(f"The LCM URL {url!r} cannot be read ({error}). A working one is {DEFAULT_URL!r}.")


def _scheme(url: str) -> str:
    try:
        return urlsplit(url).scheme
    except ValueError as error:
        raise _unreadable(url, error) from error


def handled(bus: lcm.LCM, wait_ms: int = 0) -> bool:
    """Handle one message, waiting up to `wait_ms` for it; return whether there was one.

    LCM reports a signal during the wait (such as SIGTERM) as a failure, so a failure is tried again. Raises OSError if
    it repeats.
    """
    try:
        return bus.handle_timeout(wait_ms) > 0
    except OSError:
        return bus.handle_timeout(wait_ms) > 0


def open_lcm(url: str) -> lcm.LCM:
    """Open LCM on `url`.

    Raises BusError when the URL is wrong, the machine has no multicast route, or LCM cannot start.
    """
    scheme = _scheme(url)
    if scheme not in ("udpm", "memq", "tcpq"):
        raise BusError(f"The LCM URL {url!r} is not a live bus. Use one such as {DEFAULT_URL!r}.")
    if scheme == "udpm":
        multicast = parse_udpm(url)
        if not has_route(multicast.group):
            raise BusError(
                f"This machine has no network route for the multicast group {multicast.group}. Without a network: "
                "sudo ip link set lo multicast on && sudo ip route add 224.0.0.0/4 dev lo"
            )
    try:
        return lcm.LCM(url)
    except RuntimeError as error:
        raise BusError(
            f"LCM could not start on {url!r}. Check that the address is a multicast address, that the port is free for "
            "UDP, and that the network interface allows multicast (ip link show)."
        ) from error


def is_shared(url: str) -> bool:
    """Return whether messages sent on the bus at `url` leave this computer. Raises BusError when the URL is wrong."""
    scheme = _scheme(url)
    if scheme == "udpm":
        return parse_udpm(url).ttl > 0
    return scheme == "tcpq" and urlsplit(url).hostname not in (None, "localhost", "127.0.0.1", "::1")


def key_of(url: str) -> bytes | None:
    """Return the key for the bus at `url`, None where there is none.

    Raises BusError where a bus would be shared without one, KeyFileError when the key cannot be used.
    """
    key = key_in_use()
    if key is None and is_shared(url) and not configuration.is_insecure():
        raise BusError(
            f"{url!r} shares the bus with other computers, and there is no key: anybody on the network could drive the "
            "robots. Make a key with: cmr key new; copy it to the other computers. Or start with --insecure."
        )
    return key


def verifier_of(url: str) -> Verifier:
    """Return the verifier of messages on the bus at `url`. Raises the errors of `key_of`."""
    key = key_of(url)
    return Verifier(None if configuration.is_insecure() else key)


def check(url: str | None) -> None:
    """Try the bus that a process will use, before any lengthy work.

    Raises BusError when it cannot be used, including for lack of a key.
    """
    resolved = resolve_url(url)
    key_of(resolved)
    self_test(open_lcm(resolved), resolved)


def has_route(group: str) -> bool:
    """Return whether the kernel knows where to send packets for this IPv4 address."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((group, 9))  # connecting a UDP socket sends nothing; it only looks up the route
        except OSError:
            return False
    return True


def warnings(url: str, rmem_max: Path = Path("/proc/sys/net/core/rmem_max")) -> list[str]:
    """Return warnings about settings that will lose messages under load, each with its remedy.

    Raises BusError when the URL is wrong.
    """
    if _scheme(url) != "udpm":
        return []
    wanted = parse_udpm(url).recv_buf_size
    try:
        allowed = int(rmem_max.read_text())
    except (OSError, ValueError):
        return []
    if wanted == 0:
        return [f"The LCM URL sets no recv_buf_size: bursts will be lost. Add recv_buf_size=4194304 to {url!r}."]
    if allowed < wanted:
        return [
            f"The kernel allows a receive buffer of {allowed} bytes, less than the {wanted} asked for: bursts may be "
            f"lost. To allow it: sudo sysctl -w net.core.rmem_max={wanted}"
        ]
    return []


def self_test(bus: lcm.LCM, url: str) -> None:
    """Send one message to ourselves and wait for it.

    Raises BusError when it does not come back: a missing multicast route or a firewall causes this.
    """
    token = struct.pack(">iq", os.getpid(), time.monotonic_ns())
    arrived: list[bytes] = []
    subscription = bus.subscribe(SELF_TEST, lambda _channel, data: arrived.append(data))
    bus.publish(SELF_TEST, token)
    deadline = time.monotonic() + SELF_TEST_SECONDS
    while token not in arrived and time.monotonic() < deadline:
        if select.select([bus.fileno()], [], [], 0.05)[0]:
            handled(bus)
    bus.unsubscribe(subscription)
    if token not in arrived:
        group = parse_udpm(url).group
        raise BusError(
            f"A message sent on {url!r} did not come back. Multicast does not work here: check the firewall "
            f"(it must allow UDP to {group}) and the interface of `ip route get {group}`."
        )
