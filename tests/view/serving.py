"""A page server on the loopback whose visitors get a process that only writes down what it hears."""

import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin

from cmr.view.curves import LiveCurves
from cmr.view.entrance.door import Address
from cmr.view.orders import Orders
from cmr.view.server import PageServer
from cmr.view.visit import NO_ROOM
from tests.support.view_states import NOW, showing, three

TOKEN = "a secret of the test"
PATIENCE = 60.0  # s; a busy computer may be slow


class Serving:
    """A server of pages of `sessions`, whose processes run the Python `program` with a file, a robot and the rest."""

    def __init__(self, folder: Path, sessions: Callable[..., Any], program: str, first_port: int) -> None:
        self.heard = folder / "heard.txt"
        live: Any = SimpleNamespace(
            **{"state": showing(three(NOW)), "orders": Orders(), "name": "live", "curves": LiveCurves()},
            **{"panel": lambda: None, "head": lambda: "", "sources": list},
        )

        def command(robot_id: int, rest: object) -> list[str]:
            options = rest if isinstance(rest, Sequence) else [str(rest)]
            return [sys.executable, "-c", program, str(self.heard), str(robot_id), *options]

        beside = [partial(sessions, command)]
        self.server = PageServer(Address("127.0.0.1", first_port), TOKEN, NO_ROOM, live, beside)
        self.port = int(self.server.url.rsplit(":", 1)[1])

    def connect(self, path: str, origin: str | None = None) -> ClientConnection:
        """Open the socket of the page at this path, as a page of this origin does."""
        named = Origin(origin) if origin is not None else None
        return connect(f"ws://127.0.0.1:{self.port}{path}", origin=named, compression=None)

    def text(self) -> str:
        """Return what the processes have written down."""
        with suppress(FileNotFoundError):
            return self.heard.read_text()
        return ""

    def until(self, is_true: Callable[[], bool]) -> None:
        """Wait until something is true."""
        end = time.monotonic() + PATIENCE
        while not is_true():
            assert time.monotonic() < end, self.text()
            time.sleep(0.01)
