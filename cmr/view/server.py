"""The web server: one scene for all visitors, a page for each, and the queue of what they wish."""

import io
import time
import warnings
from collections.abc import Callable
from contextlib import redirect_stdout
from queue import Empty

import viser

from cmr.view.camera import INITIAL
from cmr.view.page import Page
from cmr.view.picture import picture_of
from cmr.view.replay_panel import ReplayPanel
from cmr.view.robots import Integers
from cmr.view.stage import Stage
from cmr.view.state import ViewState
from cmr.view.wishes import CLICK, COME, LEAVE, Permission, Wish, Wishes
from cmr.world.interaction.obstacles import Geofence, Obstacles

TRAILS_EVERY = 0.5  # s
PANELS_EVERY = 0.5  # s
THIS_COMPUTER = ("127.0.0.1", "localhost")


class _Server(viser.ViserServer):
    """Viser's server, which nobody can make reachable from the internet."""

    def request_share_url(self, verbose: bool = True) -> str | None:  # noqa: ARG002 - the name is viser's
        """Do not open the tunnel that any visitor could ask for."""
        return None


class PageServer:
    """Serves pages at `host` and `port`; if the port is taken, at the next free one.

    `replay` makes the part of a new page that plays a log, or None. Visitors' wishes go into `wishes`; only
    those come that each visitor is allowed, with the `token`. Raises OSError where it cannot serve.
    """

    def __init__(
        self,
        host: str,
        port: int,
        token: str,
        obstacles: Obstacles,
        geofence: Geofence | None,
        replay: Callable[[], ReplayPanel | None],
    ) -> None:
        self.wishes: Wishes = Wishes()
        self.pages: dict[int, Page] = {}
        self._token, self._replay = token, replay
        self._on_this_computer = host in THIS_COMPUTER
        self._replays: dict[int, ReplayPanel] = {}
        self._solid_ids: Integers | None = None
        self._trails_due = self._panels_due = 0.0
        # A visitor who leaves while he is told something is no news.
        warnings.filterwarnings("ignore", ".* on a closed connection", UserWarning)
        with redirect_stdout(io.StringIO()):  # its banner; where the page is, is said by the process
            self._server = _Server(host, port, "cmr-view", verbose=False)
        self.url = f"http://{host}:{self._server.get_port()}"
        self._server.gui.configure_theme(
            control_layout="fixed", control_width="large", show_logo=False, show_share_button=False
        )
        self._server.initial_camera.up = (0.0, 0.0, 1.0)
        self._server.initial_camera.position = INITIAL
        self._stage = Stage(self._server.scene, obstacles, geofence)
        self._stage.robots.on_click(lambda visitor, place: self.wishes.put(Wish(CLICK, visitor, place)))
        self._server.on_client_connect(lambda client: self.wishes.put(Wish(COME, client.client_id, client)))
        self._server.on_client_disconnect(lambda client: self.wishes.put(Wish(LEAVE, client.client_id)))

    def wished(self) -> list[Wish]:
        """Let visitors come and go, and return what else they wish."""
        result: list[Wish] = []
        while True:
            try:
                wish = self.wishes.get_nowait()
            except Empty:
                if result:  # what comes of it is to be seen at once
                    self._trails_due = self._panels_due = 0.0
                return result
            if wish.what == COME:
                self._welcome(wish)
            elif wish.what == LEAVE:
                self._forget(wish.visitor)
            elif wish.what == CLICK:
                self._choose(wish)
            else:
                result.append(wish)

    def show(self, state: ViewState, head: str) -> None:
        """Draw the moment on all pages; panels and trails less often."""
        now = time.monotonic()
        if not self.pages and now < self._panels_due:
            return  # nobody looks; who comes sees what was drawn last
        with_trails, with_panels = now >= self._trails_due, now >= self._panels_due
        self._trails_due = now + TRAILS_EVERY if with_trails else self._trails_due
        self._panels_due = now + PANELS_EVERY if with_panels else self._panels_due
        picture = picture_of(state)
        self._solid_ids = picture.solid_ids
        self._stage.show(picture)
        for visitor, page in list(self.pages.items()):
            try:
                page.show_scene(state, with_trails)
                if with_panels:
                    page.show_panels(state, head)
                    if visitor in self._replays:
                        self._replays[visitor].show()
            except RuntimeError:  # viser: the visitor has just left
                self._forget(visitor)

    def stop(self) -> None:
        """Close all connections."""
        with redirect_stdout(io.StringIO()):
            self._server.stop()

    def _welcome(self, wish: Wish) -> None:
        replay = self._replay()
        try:
            permission = Permission(self._token, self._on_this_computer)
            page = Page(wish.value, permission, self.wishes, replay)
        except RuntimeError:  # left at once
            return
        self.pages[wish.visitor] = page
        if replay is not None:
            self._replays[wish.visitor] = replay
        self._trails_due = self._panels_due = 0.0

    def _forget(self, visitor: int) -> None:
        self.pages.pop(visitor, None)
        self._replays.pop(visitor, None)

    def _choose(self, wish: Wish) -> None:
        ids = self._solid_ids
        if ids is not None and wish.visitor in self.pages and 0 <= wish.value < len(ids):
            self.pages[wish.visitor].choose(int(ids[wish.value]))
