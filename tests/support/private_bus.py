"""An LCM bus of one's own, on the loopback."""

import socket


def private_url() -> str:
    """Return the URL of a bus that nobody else is on: a free port, and nothing leaves this host."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("", 0))
        return f"udpm://239.255.76.67:{probe.getsockname()[1]}?ttl=0&recv_buf_size=4194304"
