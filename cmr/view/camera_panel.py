"""The panel with pictures of cameras over the floor, including virtual robots."""

import numpy as np
import viser

from cmr.msg import camera_image_t
from cmr.view.data.state import Arrival, ViewState
from cmr.view.inputs import write

STALE = 2.0  # s after which the age of a picture is shown
NO_CAMERA = "no camera"


class CameraPanel:
    """The last picture of one camera, in a folder shown while any camera is received."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._folder = gui.add_folder("camera", visible=False)
        with self._folder:
            self._choice = gui.add_dropdown("camera", (NO_CAMERA,), initial_value=NO_CAMERA, visible=False)
            self._image = gui.add_image(np.zeros((1, 1, 3), np.uint8), label="", format="jpeg")
        self._shown: Arrival[camera_image_t] | None = None

    def show(self, state: ViewState) -> None:
        """Show the last picture of the chosen camera if it has changed."""
        if not state.cameras:
            self._folder.visible = False
            self._shown = None
            return
        self._offer(tuple(sorted(state.cameras)))
        heard = state.cameras[self._choice.value]
        if heard is not self._shown:
            self._shown = heard
            # Forward it as encoded by the camera's process: viser would decode and encode each picture again.
            self._image._data = bytes(heard.message.jpeg)
            self._folder.visible = True
        self._image.label = caption(heard, state.now)

    def _offer(self, names: tuple[str, ...]) -> None:
        if self._choice.options == names:
            return
        chosen = self._choice.value if self._choice.value in names else names[0]
        self._choice.options = names
        write(self._choice, chosen)
        self._choice.visible = len(names) > 1


def caption(heard: Arrival[camera_image_t], now: int) -> str:
    """Return a picture's caption: camera, size, and age [`now`: us] if it is old."""
    message, age = heard.message, (now - heard.utime) / 1e6
    title = f"{message.camera}, {message.width} x {message.height}"
    return title if age < STALE else f"{title}, no picture for {age:.0f} s"
