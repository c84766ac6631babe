"""The web server: its visitors, the queue of their requests, and their own logs.

A log that a visitor opens is visible only to that visitor, and does not affect others, whatever it contains. The
emergency stop of a live page keeps working.
"""

import asyncio
import io
import time
import traceback
import warnings
from collections.abc import Callable, Sequence
from contextlib import redirect_stdout
from pathlib import Path
from queue import Empty

import viser
from websockets.asyncio.server import ServerConnection

from cmr.bus.fields import FieldName
from cmr.view.camera import INITIAL
from cmr.view.entrance.door import Address, Beside, Door, address_of, guarding
from cmr.view.entrance.guesses import Guesses
from cmr.view.entrance.refusals import Refusals
from cmr.view.inputs import check_inputs
from cmr.view.opening import MOST_OPENED, LogFolder, OpenedLog, RefusedLog, check_size
from cmr.view.page import REFUSED, Surroundings, refuse
from cmr.view.picture import Picture, picture_of
from cmr.view.requests import CLICK, CLOSE, COME, JUMP, LEAVE, OPEN, PAUSE, SPEED, Permission, Request, Requests
from cmr.view.showing import LogShowing, Showing, stop_line
from cmr.view.uploads import Upload
from cmr.view.visit import NO_ROOM, Room, Visit, Visitor

MakeBeside = Callable[[str, Guesses], Beside]  # of the token

TRAILS_EVERY = 0.5  # s
PANELS_EVERY = 0.5  # s
SHARE_OF_OPENED = 0.1  # of the time for reading one visitor's log; there are MOST_OPENED


class _Server(viser.ViserServer):
    """Viser's server without the option to expose it on the internet."""

    def request_share_url(self, verbose: bool = True) -> str | None:  # noqa: ARG002 - the name is viser's
        """Refuse to open the tunnel that any visitor could request."""
        return None


class PageServer:
    """Serves pages at an address; if the port is taken, at the next free one.

    All visitors see `showing` in a `room` until they open a log. Requests that a visitor may make with the `token` go
    into `requests`. Additional pages `beside` are served, too; their makers get the counter of token guesses. Raises
    OSError if it cannot serve.
    """

    def __init__(
        self, address: Address, token: str, room: Room, showing: Showing, beside: Sequence[MakeBeside] = ()
    ) -> None:
        self.requests: Requests = Requests()
        self.visits: dict[int, Visit] = {}
        self._token, self._room, self._showing = token, room, showing
        address.check()
        self._on_this_computer = address.is_for_this_computer
        self.refusals = Refusals()
        self._guesses = Guesses(self.refusals)
        self._logs = LogFolder()
        self._trails_due = self._panels_due = 0.0
        pages = [make(token, self._guesses) for make in beside]
        self._beside = tuple((page.page, page.title) for page in pages)
        # A visitor leaving during a transmission is not worth a warning.
        warnings.filterwarnings("ignore", ".* on a closed connection", UserWarning)
        # The process itself prints the address.
        with redirect_stdout(io.StringIO()), guarding(Door(address, self.refusals), pages):
            self._server = _Server(address.host, address.port, "cmr-view", verbose=False)
        self.url = address.url(self._server.get_port())
        self._server.gui.configure_theme(control_width="large", show_logo=False, show_share_button=False)
        self._server.gui.main_panel.dock_right()
        self._server.initial_camera.up = (0.0, 0.0, 1.0)
        self._server.initial_camera.position = INITIAL
        self._server.on_client_connect(lambda client: self.requests.put(Request(COME, client.client_id, client)))
        self._server.on_client_disconnect(lambda client: self.requests.put(Request(LEAVE, client.client_id)))

    def requested(self, utime: int) -> list[Request]:
        """Handle visitors that come, go, and use own logs; return the other requests, `utime` [us]."""
        result: list[Request] = []
        while True:
            try:
                request = self.requests.get_nowait()
            except Empty:
                if result:  # so that the result is visible at once
                    self._trails_due = self._panels_due = 0.0
                return result
            if not self._fulfil(request, utime):
                result.append(request)

    def show(self, seconds: float) -> None:
        """Draw all pages; advance the logs of single visitors by `seconds`."""
        now = time.monotonic()
        with_trails, with_panels = now >= self._trails_due, now >= self._panels_due
        self._trails_due = now + TRAILS_EVERY if with_trails else self._trails_due
        self._panels_due = now + PANELS_EVERY if with_panels else self._panels_due
        if with_panels:
            self._want_curves()
        common = picture_of(self._showing.state) if self.visits else None
        for visit in list(self.visits.values()):
            self._do_for(visit, lambda visit: self._draw(visit, common, seconds, with_trails, with_panels))

    def stop(self) -> None:
        """Close all connections."""
        with redirect_stdout(io.StringIO()):
            self._server.stop()
        self._logs.clean()

    def _fulfil(self, request: Request, utime: int) -> bool:
        """Fulfil requests that concern one visitor only; return whether it was one."""
        visit = self.visits.get(request.visitor)
        if request.what == COME:
            self._welcome(request.value)
        elif request.what == LEAVE:
            if visit is not None:
                visit.visitor.upload.end()
            self._forget(request.visitor)
        elif request.what == CLICK and visit is not None:
            visit.choose(request.value)
        elif request.what == OPEN:
            self._open(visit, request.value)
        elif request.what == CLOSE and visit is not None:
            self._close(visit)
        elif visit is not None and visit.log is not None and request.what in (PAUSE, SPEED, JUMP):
            self._do_for(visit, lambda visit: visit.showing.fulfil(request, utime))
            self._panels_due = 0.0
        else:
            return request.what == CLICK
        return True

    def _welcome(self, client: viser.ClientHandle) -> None:
        address = address_of(self._connection(client.client_id))
        permission = Permission(self._token, self._on_this_computer, self._guesses, address)

        def check(size: int) -> None:
            if not permission.asks(OPEN):
                raise RefusedLog(REFUSED)
            check_size(size, sum(visit.visitor.upload.arriving for visit in list(self.visits.values())))

        def take(log: OpenedLog) -> None:
            self.requests.put(Request(OPEN, client.client_id, log))

        try:
            check_inputs(client, lambda: self.refusals.count("values that no input takes", address))
            upload = Upload(client, self._logs, check, take, lambda sentence: refuse(client, sentence))
            self._show_to(Visitor(client, permission, upload), self._showing, None)
        except RuntimeError:  # viser: left at once
            pass

    def _show_to(self, visitor: Visitor, showing: Showing, log: OpenedLog | None) -> None:
        """Give a visitor a page that shows this."""
        self._forget(visitor.client.client_id)
        room = self._room if log is None else NO_ROOM
        surroundings = Surroundings(
            curve_windows=tuple(showing.curves.windows),
            back_to="" if log is None else self._showing.name,
            has_robots=self._showing.panel() is None,
            has_fence=room.geofence is not None,
            beside=self._beside if log is None else (),
        )
        try:
            visit = Visit(visitor, self.requests, showing, room, surroundings, log)
        except RuntimeError:  # viser: left at once
            if log is not None:
                log.remove()
            return
        self.visits[visitor.client.client_id] = visit
        self._trails_due = self._panels_due = 0.0

    def _open(self, visit: Visit | None, log: OpenedLog) -> None:
        others = sum(other.log is not None for other in self.visits.values() if other is not visit)
        if visit is None or others >= MOST_OPENED:
            log.remove()
            if visit is not None:
                visit.page.refuse(f"{MOST_OPENED} logs are open on other pages. Close one of them, then try again.")
            return
        try:
            showing = LogShowing(log.path, log.name, SHARE_OF_OPENED)
        except OSError as error:
            visit.page.refuse(f"{log.name}: {error.strerror or error}")
            log.remove()
        else:
            self._show_to(visit.visitor, showing, log)

    def _close(self, visit: Visit) -> None:
        self._show_to(visit.visitor, self._showing, None)

    def _draw(self, visit: Visit, common: Picture | None, seconds: float, with_trails: bool, with_panels: bool) -> None:
        """Draw one visitor's page: the common view, or the visitor's own log, advanced."""
        head, picture = visit.showing.head(), common
        if visit.log is not None:
            visit.showing.advance(seconds)
            head, picture = visit.showing.head() + stop_line(self._showing.orders), picture_of(visit.showing.state)
        if picture is not None:
            visit.show(picture, head, with_trails, with_panels)

    def _do_for(self, visit: Visit, act: Callable[[Visit], None]) -> None:
        """Do something for one visitor; on failure, close that visitor's own log, or else the page."""
        try:
            act(visit)
        except RuntimeError:  # viser: the visitor has just left
            self._forget(visit.visitor.client.client_id)
        except Exception as error:
            if visit.log is None:
                self._dismiss(visit, error)
                return
            self._close(visit)  # whatever a log contains, other pages continue
            changed = self.visits.get(visit.visitor.client.client_id)
            if changed is not None:
                changed.page.refuse(f"{visit.log.name} cannot be played: {error}")

    def _dismiss(self, visit: Visit, error: Exception) -> None:
        """Close the connection of a visitor whose page cannot be drawn; the browser reconnects by itself."""
        place = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{Path(place.filename).name}:{place.lineno}"
        visitor = visit.visitor.client.client_id
        connection = self._connection(visitor)
        self.refusals.count(
            f"pages that could not be drawn ({type(error).__name__} at {where})", address_of(connection)
        )
        self._forget(visitor)
        if connection is not None:
            asyncio.run_coroutine_threadsafe(
                connection.close(1011, "This page cannot be drawn."), self._server._event_loop
            )

    def _connection(self, visitor: int) -> ServerConnection | None:
        return self._server._websock_server._live_connections.get(visitor)

    def _want_curves(self) -> None:
        """Tell everything shown which signals its visitors plot."""
        showings: dict[int, tuple[Showing, list[FieldName]]] = {id(self._showing): (self._showing, [])}
        for visit in self.visits.values():
            showings.setdefault(id(visit.showing), (visit.showing, []))[1].extend(visit.page.plotted)
        for showing, names in showings.values():
            showing.curves.want(names)

    def _forget(self, visitor: int) -> None:
        visit = self.visits.pop(visitor, None)
        if visit is not None and visit.log is not None:
            visit.log.remove()
