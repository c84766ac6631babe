"""One visitor: an own page and scene, showing the common view or the visitor's own log."""

from typing import NamedTuple

import viser

from cmr.geometry.obstacles import Geofence, Obstacles
from cmr.view.opening import OpenedLog
from cmr.view.page import Page, Surroundings
from cmr.view.picture import Picture
from cmr.view.requests import CLICK, OPEN, Permission, Request, Requests
from cmr.view.showing import Showing
from cmr.view.stage import Stage
from cmr.view.uploads import Upload, clear


class Room(NamedTuple):
    """The fixed contents of the scene."""

    obstacles: Obstacles
    geofence: Geofence | None


NO_ROOM = Room(Obstacles.none(), None)  # unknown for an uploaded log


class Visitor(NamedTuple):
    """A visitor: browser, permissions, and uploads. Lasts as long as the connection."""

    client: viser.ClientHandle
    permission: Permission
    upload: Upload


class Visit:
    """A visitor with the content shown. Raises RuntimeError, as viser does, if the visitor has just left."""

    def __init__(
        self,
        visitor: Visitor,
        requests: Requests,
        showing: Showing,
        room: Room,
        surroundings: Surroundings,
        log: OpenedLog | None = None,
    ) -> None:
        self.visitor, self.showing, self.log = visitor, showing, log
        client = visitor.client
        clear(client, visitor.upload.folder)
        self._stage = Stage(client.scene, room.obstacles, room.geofence)
        self._stage.robots.on_click(lambda visitor, place: requests.put(Request(CLICK, visitor, place)))
        self._replay = showing.panel()
        self.page = Page(client, visitor.permission, requests, self._replay, surroundings)
        self._picture: Picture | None = None

    def show(self, picture: Picture, head: str, with_trails: bool, with_panels: bool) -> None:
        """Draw the current content; panels and trails less often."""
        self._picture = picture
        self._stage.show(picture)
        self.page.show_scene(self.showing.state, with_trails)
        if with_panels:
            self.visitor.upload.allow(self.visitor.permission.allows(OPEN))
            self.page.show_panels(self.showing, head)
            if self._replay is not None:
                self._replay.show()

    def choose(self, place: int) -> None:
        """Choose the clicked robot, by its index in the last picture."""
        if self._picture is not None and 0 <= place < len(self._picture.solid_ids):
            self.page.choose(int(self._picture.solid_ids[place]))
