"""Two hosts with a cable between them: each has a network and a host name of its own, the rest is this machine's."""

import os
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

SHARED_BUS = "udpm://239.255.76.67:7667?ttl=1&recv_buf_size=4194304"
READY = 5.0  # s until a host is there


class Host:
    """A host, as long as its first process lives."""

    def __init__(self, name: str, address: str) -> None:
        self._address = address
        script = f"hostname {name} && ip link set lo up && exec sleep infinity"
        self._first = subprocess.Popen(["unshare", "--net", "--uts", "sh", "-c", script])
        self.pid = self._first.pid

    def is_there(self) -> bool:
        """Return whether it has a network of its own; it is not permitted everywhere."""
        deadline = time.monotonic() + READY
        while self._first.poll() is None and time.monotonic() < deadline:
            if Path(f"/proc/{self.pid}/comm").read_text().strip() == "sleep":
                return True
            time.sleep(0.05)
        return False

    def start(self, *command: str, environment: dict[str, str] | None = None) -> "subprocess.Popen[bytes]":
        """Start a command on it."""
        inside = ["nsenter", "-t", str(self.pid), "--net", "--uts", "--", *command]
        return subprocess.Popen(inside, env={**os.environ, **(environment or {})})

    def plug_in(self, end: str) -> None:
        """Bring its end of the cable up, and have multicasts go there."""
        script = f"ip addr add {self._address}/24 dev {end}; ip link set {end} up; ip route add 224.0.0.0/4 dev {end}"
        assert self.start("sh", "-c", script).wait() == 0

    def end(self) -> None:
        """Switch it off."""
        self._first.kill()
        self._first.wait()


@contextmanager
def two_hosts(first: str, second: str) -> Iterator[tuple[Host, Host]]:
    """Two hosts of these names, connected. Skips the test where this user may not make any."""
    hosts = Host(first, "10.77.0.1"), Host(second, "10.77.0.2")
    try:
        if not all(host.is_there() for host in hosts):
            pytest.skip("this user may not make networks (unshare --net)")
        cable = ["ip", "link", "add", "cmr-a", "netns", str(hosts[0].pid), "type", "veth"]
        subprocess.run([*cable, "peer", "name", "cmr-b", "netns", str(hosts[1].pid)], check=True)
        hosts[0].plug_in("cmr-a")
        hosts[1].plug_in("cmr-b")
        yield hosts
    finally:
        for host in hosts:
            host.end()
