"""Check connections to the page, by origin and content, before viser handles them.

Any web page open in the operator's browser can reach a server on this computer, under the server's own address or, with
a name resolved to this host (DNS rebinding), under a foreign one. So the name by which a browser calls the server
(Host) must be one of ours, and a connection must come from our own page (Origin). Viser has no setting for either, so
the websocket server that it starts is wrapped here.
"""

import asyncio
import ipaddress
import socket
import ssl
import time
from collections.abc import Awaitable, Callable, Iterator, Sequence
from contextlib import contextmanager
from http import HTTPStatus
from typing import Any, NamedTuple, Protocol
from urllib.parse import urlsplit

import websockets.asyncio.server
from websockets.asyncio.server import ServerConnection
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response
from websockets.typing import Data

from cmr.view.entrance.refusals import Refusals
from cmr.view.entrance.sent import MOST_BYTES, is_from_a_page

THIS_COMPUTER = ("127.0.0.1", "localhost")
MOST_VISITORS = 40  # each costs some percent of a core
MOST_A_SECOND = 200.0  # messages per visitor: a page sends about 60 while it is dragged
AT_ONCE = 400.0  # additional messages in a burst, as after two seconds of silence
HEADERS = {
    "X-Frame-Options": "DENY",  # another page that embeds ours could make the operator click its buttons
    "Content-Security-Policy": "frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
}
FOREIGN_NAME = "This page is served under another name. To have this one: cmr-view --allow-host NAME\n"
FOREIGN_PAGE = "Only the page that is served here may connect.\n"
NO_QUERY = "The page takes no query: open its address without what begins with '?'.\n"

Process = Callable[[ServerConnection, Request], Response | None]
Handler = Callable[[ServerConnection], Awaitable[None]]


class Address(NamedTuple):
    """The address of a page: `names` are its host's besides its addresses; `tls` encrypts, if given."""

    host: str
    port: int
    names: tuple[str, ...] = ()
    tls: ssl.SSLContext | None = None

    @property
    def is_for_this_computer(self) -> bool:
        """Whether only this computer can connect: not even through a proxy, which would need a name of ours."""
        return self.host in THIS_COMPUTER and not self.names

    def check(self) -> None:
        """Raise OSError if this is not an address of this computer: viser would wait for ever."""
        family = socket.AF_INET6 if ":" in self.host else socket.AF_INET
        with socket.socket(family, socket.SOCK_STREAM) as probe:
            probe.bind((self.host, 0))

    def url(self, port: int) -> str:
        """Return the address for a browser, where the page has this port."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{'https' if self.tls else 'http'}://{host}:{port}"


class Beside(Protocol):
    """An additional page at `page`, which connects to `connects_to`; `title` is the text of a link to it."""

    page: str
    title: str
    connects_to: str
    html: bytes

    def takes(self, data: Data) -> bool:
        """Return whether this is a valid message of the page."""

    async def serve(self, connection: ServerConnection) -> None:
        """Serve one visitor to the end."""


class Door(NamedTuple):
    """Checks visitors of an address, and counts refusals."""

    address: Address
    refusals: Refusals

    def why_not(self, request: Request, own_address: str) -> str:
        """Return why a request that reached us at `own_address` is refused; empty if it is not."""
        hosts, origins = request.headers.get_all("Host"), request.headers.get_all("Origin")
        if len(hosts) != 1 or not self._is_ours(hosts[0], own_address):
            return FOREIGN_NAME
        # Programs send no origin; every browser does, and a page cannot prevent it.
        if origins and (len(origins) > 1 or _place_of(origins[0]) != hosts[0].lower()):
            return FOREIGN_PAGE
        # With ?websocket=... viser's page would connect to a foreign server, and obey it in our name.
        return NO_QUERY if "?" in request.path else ""

    def _is_ours(self, host: str, own_address: str) -> bool:
        try:
            name = (urlsplit(f"//{host}").hostname or "").rstrip(".")
        except ValueError:
            return False
        named = {"localhost", self.address.host.lower(), *(name.lower() for name in self.address.names)}
        return name in named or _same_address(name, own_address)


@contextmanager
def guarding(door: Door, beside: Sequence[Beside] = ()) -> Iterator[None]:
    """Guard the server that viser starts within the context, and let it serve additional pages.

    Raises RuntimeError if viser does not start its server in the known way, which would leave it unguarded.
    """
    serve, guarded = websockets.asyncio.server.serve, list[int]()

    def serve_behind(handler: Any, host: str, port: int, **options: Any) -> Any:
        guarded.append(port)
        options |= {"process_request": _checking(door, options["process_request"], beside), "ssl": door.address.tls}
        options |= {"create_connection": _connections(door.refusals, beside), "max_size": MOST_BYTES}
        return serve(_limited(_parted(handler, beside)), host, port, **options)

    websockets.asyncio.server.serve = serve_behind  # type: ignore[misc, assignment]
    try:
        yield
    finally:
        websockets.asyncio.server.serve = serve  # type: ignore[misc]
    if not guarded:
        raise RuntimeError(
            "This version of viser starts its server in another way; cmr-view cannot check who connects."
        )


def _checking(door: Door, answer: Process, beside: Sequence[Beside]) -> Process:
    def process(connection: ServerConnection, request: Request) -> Response | None:
        reason = door.why_not(request, connection.local_address[0])
        if reason:
            door.refusals.count("requests under a foreign name or from a foreign page", connection.remote_address[0])
            return connection.respond(403, reason)
        html = next((one.html for one in beside if request.path == one.page), None)
        response = _page(html) if html is not None else answer(connection, request)
        if response is not None:
            response.headers.update(HEADERS)
        return response

    return process


def _page(html: bytes) -> Response:
    """Return a page as response."""
    headers = Headers({"Content-Type": "text/html; charset=utf-8", "Content-Length": str(len(html))})
    return Response(HTTPStatus.OK, "OK", headers, html)


def _parted(handler: Handler, beside: Sequence[Beside]) -> Handler:
    """Return a handler that passes visitors of additional pages to them."""

    async def handle(connection: ServerConnection) -> None:
        one = _of(connection, beside)
        await (handler if one is None else one.serve)(connection)

    return handle


def _of(connection: ServerConnection, beside: Sequence[Beside]) -> Beside | None:
    """Return the additional page of a visitor; None for viser's."""
    path = connection.request.path if connection.request is not None else ""
    return next((one for one in beside if path == one.connects_to), None)


def _limited(handler: Handler) -> Handler:
    """Limit the number of visitors; further ones are refused, and viser's page retries by itself."""
    inside = set[ServerConnection]()

    async def handle(connection: ServerConnection) -> None:
        if len(inside) >= MOST_VISITORS:
            await connection.close(1013, f"{MOST_VISITORS} pages are open.")
            return
        inside.add(connection)
        try:
            await handler(connection)
        finally:
            inside.discard(connection)

    return handle


def _connections(refusals: Refusals, beside: Sequence[Beside]) -> type[ServerConnection]:
    """Return connections that accept only messages of a page, at a page's rate."""

    class Screened(ServerConnection):
        _allowance, _since = AT_ONCE, 0.0

        async def recv(self, decode: bool | None = None) -> Data:  # type: ignore[override]
            while True:
                data = await super().recv(decode)
                await self._slow_down()
                one = _of(self, beside)
                takes = is_from_a_page if one is None else one.takes
                if takes(data):
                    return data
                refusals.count("messages that no page sends", address_of(self))

        async def _slow_down(self) -> None:
            now = time.monotonic()
            self._allowance = min(AT_ONCE, self._allowance + MOST_A_SECOND * (now - self._since)) - 1.0
            self._since = now
            if self._allowance < 0.0:  # this also slows the sender, since nothing is read
                await asyncio.sleep(-self._allowance / MOST_A_SECOND)

    return Screened


def address_of(connection: ServerConnection | None) -> str:
    """Return the remote address; empty if it is gone."""
    try:
        return str(connection.remote_address[0]) if connection is not None else ""
    except (ConnectionClosed, TypeError, IndexError):
        return ""


def _place_of(origin: str) -> str:
    """Return host and port of an origin, as browsers write them in Host; empty if it has none."""
    try:
        parts = urlsplit(origin)
    except ValueError:
        return ""
    return parts.netloc.lower() if parts.scheme in ("http", "https") else ""


def _same_address(name: str, own: str) -> bool:
    try:
        return ipaddress.ip_address(name) == ipaddress.ip_address(own.split("%", 1)[0])
    except ValueError:
        return False
