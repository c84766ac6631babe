"""The panels of one visitor's page, and what only that visitor sees of the scene."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import viser

from cmr.view import words
from cmr.view.camera import FOLLOW, FREE, TOP, Camera
from cmr.view.camera_panel import CameraPanel
from cmr.view.charts import Chart, distances, estimates
from cmr.view.inputs import write
from cmr.view.look import page_look
from cmr.view.picture import Lines, rays, trails
from cmr.view.replay_panel import ReplayPanel
from cmr.view.shapes import LENGTH, at_height, circle
from cmr.view.stage import TRAIL_WIDTH, LineSet
from cmr.view.state import ViewState
from cmr.view.wishes import FIGURE_EIGHT, RELEASE, STOP, Permission, Wish, Wishes
from cmr.view.words import ESTIMATES

SETTLED = 1.0  # s after which a new page takes to where its camera is put
RAY_WIDTH, RING_WIDTH = 0.006, 0.015  # m
REFUSED = "Nothing was sent. Enter the token from the terminal running cmr-view, then try again."
WRONG = "Nothing was sent. This is not the token in the terminal running cmr-view."
TAB_NAMES = ("view", "robot", "processes", "bus", "calibration", "twins")


class Page:
    """What one visitor sees and may do. `show_scene` is to be called at each picture, `show_panels` now and then."""

    def __init__(
        self, client: viser.ClientHandle, permission: Permission, wishes: Wishes, replay: ReplayPanel | None
    ) -> None:
        self.client = client
        self.permission = permission
        self._wishes = wishes
        self._replay = replay
        self._camera = Camera(client)
        self._mode_changed = False
        self._overview_due: float | None = time.monotonic() + SETTLED
        gui = client.gui
        self._head = gui.add_html("")
        gui.add_html(page_look())
        self._add_orders(gui)
        self._camera_panel = CameraPanel(gui)
        if replay is not None:
            replay.add(gui, self.wish)
        self._add_tabs(gui)
        self._trails = LineSet(client.scene, "/trails", TRAIL_WIDTH)
        self._rays = LineSet(client.scene, "/rays", RAY_WIDTH)
        self._ring = LineSet(client.scene, "/chosen", RING_WIDTH)

    @property
    def chosen(self) -> int:
        """The robot that was chosen."""
        return int(self._robot.value)

    def choose(self, robot_id: int) -> None:
        """Choose a robot, as by a click on it."""
        write(self._robot, robot_id)

    def wish(self, what: str, value: Any = None) -> None:
        """Ask for something, if the visitor may."""
        if self.permission.asks(what):
            self._wishes.put(Wish(what, self.client.client_id, value))
        else:
            why = WRONG if self._token.value.strip() else REFUSED
            self.client.add_notification("Refused", why, color="red", auto_close_seconds=5.0)

    def show_scene(self, state: ViewState, with_trails: bool) -> None:
        """Draw what is this visitor's own."""
        robots = state.present()
        if self._overview_due is not None and time.monotonic() >= self._overview_due:
            self._overview_due, self._mode_changed = None, True
        if self._mode_changed:
            self._mode_changed = False
            self._camera.choose(self._mode.value, robots)
        self._camera.advance(robots, self.chosen)
        self._camera_panel.show(state)
        place = robots.place(self.chosen)
        around = circle(place[0], place[1], 0.8 * LENGTH) if place else np.empty((0, 2, 2))
        self._ring.show(Lines(at_height(around, 0.01), np.zeros((len(around), 2, 3), np.uint8)))
        if with_trails:
            self._trails.show(trails(state.trails.shown(state.now, self._trail_seconds.value)))
            self._rays.show(rays(state, self.chosen))

    def show_panels(self, state: ViewState, head: str) -> None:
        """Bring the panels up to date; `head` is HTML for the top."""
        self._head.content = head
        self._panels["robot"].content = words.robot(state, self.chosen)
        self._panels["processes"].content = words.processes(state)
        self._panels["bus"].content = words.bus(state)
        self._panels["twins"].content = words.twins(state)
        self._show_calibration(state)
        self._show_divergence(state)

    def _show_calibration(self, state: ViewState) -> None:
        robot_id = self.chosen if self.chosen in state.calibrations else next(iter(state.calibrations), None)
        if robot_id is None:
            self._panels["calibration"].content = words.sentence("No cmr-calibrate has been heard yet.")
            columns = {name: np.empty((4, 0)) for name, _ in ESTIMATES}
        else:
            history = state.calibrations[robot_id]
            controller = words.controller_of(state, robot_id)
            self._panels["calibration"].content = words.calibration(history[-1].message, controller)
            columns = estimates(history, controller)
        self._paths.content = "" if robot_id is None else words.drives(state, robot_id)
        for name, chart in self._estimates.items():
            chart.show(columns[name])

    def _show_divergence(self, state: ViewState) -> None:
        robot_id = self.chosen if self.chosen in state.divergence else next(iter(state.divergence), None)
        history = () if robot_id is None else state.divergence[robot_id]
        self._divergence.show(distances(history, state.now) if history else np.empty((2, 0)))

    def _add_orders(self, gui: viser.GuiApi) -> None:
        plays_freely = self._replay is not None and self.permission.on_this_computer
        with gui.add_folder("commands", visible=not plays_freely):
            self._token = gui.add_text("token", "", hint="that cmr-view printed when it started")
            if self._replay is None:  # a log has no robots to command
                self._add_robot_orders(gui)
        self._token.on_update(self._take_token)

    def _add_robot_orders(self, gui: viser.GuiApi) -> None:
        stop = gui.add_button("EMERGENCY STOP", color="red", hint="or press Esc")
        release = gui.add_button("reset emergency stop ...", color="gray")
        eight = gui.add_button("start figure-eight", hint="of the chosen robot")
        stop.on_click(lambda _event: self.wish(STOP))
        gui.add_command("EMERGENCY STOP", hotkey="escape").on_trigger(lambda _event: self.wish(STOP))
        release.on_click(lambda _event: self._ask_release())
        eight.on_click(lambda _event: self.wish(FIGURE_EIGHT, self.chosen))

    def _add_tabs(self, gui: viser.GuiApi) -> None:
        self._panels: dict[str, viser.GuiHtmlHandle] = {}
        tabs = gui.add_tab_group()
        for name in TAB_NAMES:
            with tabs.add_tab(name):
                if name == "view":
                    self._add_view(gui)
                else:
                    self._panels[name] = gui.add_html("")
                if name == "calibration":
                    titles = {parameter: f"{parameter} [{unit}]" for parameter, unit in ESTIMATES}
                    self._paths = gui.add_html("")
                    self._estimates = {key: Chart(gui, title, True) for key, title in titles.items()}
                if name == "twins":
                    self._divergence = Chart(gui, "distance of robot and twin [cm]", False, from_zero=True)

    def _add_view(self, gui: viser.GuiApi) -> None:
        self._robot = gui.add_number("robot", 0, min=0, step=1, hint="or click on it")
        self._mode = gui.add_dropdown("camera", (FREE, TOP, FOLLOW), initial_value=TOP)
        self._trail_seconds = gui.add_slider("trails [s]", 0, 60, 1, 10)
        self._mode.on_update(self._change_mode)

    def _change_mode(self, _event: Any) -> None:
        self._mode_changed = True

    def _take_token(self, _event: Any) -> None:
        if self._token.value and self.permission.try_token(self._token.value):
            write(self._token, "")
            self._token.label = "token taken"
            self._token.disabled = True

    def _ask_release(self) -> None:
        """Ask whether the emergency stop is really to be released."""
        if not self.permission.granted:
            self.wish(RELEASE)  # which is refused
            return
        modal = self.client.gui.add_modal("Reset the emergency stop?")
        with modal:
            self.client.gui.add_markdown("Robots that are commanded will move again.")
            yes, no = self.client.gui.add_button("reset", color="red"), self.client.gui.add_button("leave it engaged")
        yes.on_click(self._closing(modal, lambda: self.wish(RELEASE)))
        no.on_click(self._closing(modal, lambda: None))

    def _closing(self, modal: Any, act: Callable[[], None]) -> Callable[[Any], None]:
        def close(_event: Any) -> None:
            act()
            modal.close()

        return close
