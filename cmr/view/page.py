"""The panels of one visitor's page, and this visitor's own parts of the scene."""

import math
import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import viser

from cmr.bus.fields import FieldName
from cmr.view import words
from cmr.view.camera import FOLLOW, FREE, TOP, Camera
from cmr.view.camera_panel import CameraPanel
from cmr.view.charts import Chart, distances, estimates
from cmr.view.data.state import ViewState
from cmr.view.inputs import write
from cmr.view.investigating import card, investigated
from cmr.view.look import legend, page_look
from cmr.view.picture import Lines, rays, trails
from cmr.view.plots import Plots
from cmr.view.replay_panel import ReplayPanel
from cmr.view.requests import CLOSE, FIGURE_EIGHT, RELEASE, STOP, Permission, Request, Requests
from cmr.view.shapes import LENGTH, at_height, circle
from cmr.view.showing import Showing
from cmr.view.stage import TRAIL_WIDTH, LineSet
from cmr.view.words import ESTIMATES

BESIDE = '<a href="{}" target="_blank" style="display:block;padding:0 1em">{}</a>'
READING_TIME = 8.0  # s for which a refusal is shown
SETTLED = 1.0  # s until a new page accepts its camera position
RAY_WIDTH, RING_WIDTH = 0.006, 0.015  # m
REFUSED = "Nothing was sent. Enter the token from the terminal running cmr-view, then try again."
WRONG = "Nothing was sent. This is not the token in the terminal running cmr-view."
WAIT = "Nothing was sent. Too many wrong tokens came from your address: the next is looked at in {:.0f} s."
TYPED = 0.5  # s after the last keystroke until a typed token counts as complete
TAB_NAMES = ("view", "robot", "plots", "processes", "bus", "calibration", "twins")


def refuse(client: viser.ClientHandle, sentence: str) -> None:
    """Tell a visitor why something is not done."""
    client.add_notification("Refused", sentence, color="red", auto_close_seconds=READING_TIME)


class Surroundings(NamedTuple):
    """Further properties of a page.

    `curve_windows` are the time spans of its plots; `back_to` names the common view, if this visitor sees an own log;
    `has_robots` says whether there is a bus with robots to stop, `has_fence` whether a geofence is drawn, `beside` are
    path and title of additional pages.
    """

    curve_windows: tuple[str, ...]
    back_to: str
    has_robots: bool
    has_fence: bool
    beside: tuple[tuple[str, str], ...] = ()


class Page:
    """One visitor's page. Call `show_scene` for each picture, `show_panels` occasionally."""

    def __init__(
        self,
        client: viser.ClientHandle,
        permission: Permission,
        requests: Requests,
        replay: ReplayPanel | None,
        surroundings: Surroundings,
    ) -> None:
        self.client = client
        self.permission = permission
        self._requests = requests
        self._replay = replay
        self._surroundings = surroundings
        self._camera = Camera(client)
        self._mode_changed = False
        self._typed, self._tried = 0.0, ""  # when the token last changed [s], and what was last tried
        self._close_question: Callable[[], None] | None = None  # closes an open dialog
        self._overview_due: float | None = time.monotonic() + SETTLED
        gui = client.gui
        self._head = gui.add_html("")
        gui.add_html(page_look())
        if surroundings.back_to:
            back = gui.add_button(f"back to {surroundings.back_to}")
            back.on_click(lambda _event: self.request(CLOSE))
        self._legend = gui.add_html("")
        self._investigation = gui.add_html("")
        self._add_orders(gui)
        self._camera_panel = CameraPanel(gui)
        if replay is not None:
            replay.add(gui, self.request)
        self._add_tabs(gui)
        self._trails = LineSet(client.scene, "/trails", TRAIL_WIDTH)
        self._rays = LineSet(client.scene, "/rays", RAY_WIDTH)
        self._ring = LineSet(client.scene, "/chosen", RING_WIDTH)

    @property
    def chosen(self) -> int:
        """The chosen robot."""
        return int(self._robot.value)

    @property
    def plotted(self) -> list[FieldName]:
        """The signals plotted by the visitor."""
        return self._plots.chosen

    def choose(self, robot_id: int) -> None:
        """Choose a robot, as by a click on it."""
        write(self._robot, robot_id)

    def request(self, what: str, value: object = None) -> None:
        """Request something, if the visitor may."""
        self._try_token()
        if self.permission.asks(what):
            self._requests.put(Request(what, self.client.client_id, value))
        elif self.permission.wait > 0.0:
            self.refuse(WAIT.format(math.ceil(self.permission.wait)))
        else:
            self.refuse(WRONG if self._token.value.strip() else REFUSED)

    def refuse(self, sentence: str) -> None:
        """Say why something is not done."""
        refuse(self.client, sentence)

    def show_scene(self, state: ViewState, with_trails: bool) -> None:
        """Draw this visitor's own parts of the scene."""
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

    def show_panels(self, showing: Showing, head: str) -> None:
        """Update the panels; `head` is HTML for the top."""
        state = showing.state
        if time.monotonic() - self._typed >= TYPED:
            self._try_token()
        self._head.content = head
        self._legend.content = legend(state, self._surroundings.has_fence)
        self._investigation.content = card(investigated(state, self.chosen))
        self._plots.show(showing.curves, showing.sources(), state.now)
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
        has_robots = self._surroundings.has_robots  # a log has none to command
        with gui.add_folder("commands", visible=has_robots or not self.permission.on_this_computer):
            self._token = gui.add_text("token", "", hint="from the terminal running cmr-view")
            if has_robots:
                self._add_robot_orders(gui)
        self._token.on_update(self._note_typing)
        self._show_permission()

    def _add_robot_orders(self, gui: viser.GuiApi) -> None:
        stop = gui.add_button("EMERGENCY STOP", color="red", hint="or press Esc")
        release = gui.add_button("reset emergency stop ...", color="gray")
        stop.on_click(lambda _event: self.request(STOP))
        gui.add_command("EMERGENCY STOP", hotkey="escape").on_trigger(lambda _event: self._take_escape())
        release.on_click(lambda _event: self._ask_release())
        if self._replay is None:
            eight = gui.add_button("start figure-eight", hint="of the chosen robot")
            eight.on_click(lambda _event: self.request(FIGURE_EIGHT, self.chosen))
        for path, title in self._surroundings.beside:
            gui.add_html(BESIDE.format(path, title))

    def _add_tabs(self, gui: viser.GuiApi) -> None:
        self._panels: dict[str, viser.GuiHtmlHandle] = {}
        tabs = gui.add_tab_group()
        for name in TAB_NAMES:
            tab = tabs.add_tab(name)
            with tab:
                if name == "view":
                    self._add_view(gui)
                elif name == "plots":
                    self._plots = Plots(gui, tab, self._surroundings.curve_windows)
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

    def _change_mode(self, _event: object) -> None:
        self._mode_changed = True

    def _note_typing(self, _event: object) -> None:
        self._typed = time.monotonic()

    def _try_token(self) -> None:
        """Try the typed token once it is complete: otherwise each prefix would count as a wrong one."""
        text = self._token.value
        if not text or text == self._tried or self.permission.granted or self.permission.wait > 0.0:
            return
        self._tried = text
        if self.permission.try_token(text):
            write(self._token, "")
            self._show_permission()

    def _show_permission(self) -> None:
        if self.permission.granted:
            self._token.label = "token taken"
            self._token.disabled = True

    def _ask_release(self) -> None:
        """Ask for confirmation before releasing the emergency stop."""
        self._try_token()
        if not self.permission.granted:
            self.request(RELEASE)  # which is refused
            return
        if self._close_question is not None:
            return
        question = self.client.gui.add_modal("Reset the emergency stop?")
        self._close_question = question.close
        with question:
            self.client.gui.add_markdown("Robots that are commanded will move again.")
            yes, no = self.client.gui.add_button("reset", color="red"), self.client.gui.add_button("leave it engaged")
        yes.on_click(lambda _event: self._answer(RELEASE))
        no.on_click(lambda _event: self._answer(None))

    def _answer(self, requested: str | None) -> None:
        """Close the question; carry out the request, if confirmed."""
        close, self._close_question = self._close_question, None
        if close is not None:
            close()
        if requested is not None:
            self.request(requested)

    def _take_escape(self) -> None:
        """Close an open question; otherwise stop the robots."""
        if self._close_question is None:
            self.request(STOP)
        else:
            self._answer(None)
