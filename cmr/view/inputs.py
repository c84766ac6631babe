"""Work around viser's stubs, which mark input values read-only, and its encoder, which sends only plain texts.

An input is set from its browser only to valid values: viser itself accepts anything, of any size.
"""

from collections.abc import Callable
from typing import Any, TypeVar

import viser
from viser import _messages
from viser.infra import ClientId

from cmr.report.markup import Html

LONGEST = 256  # characters of a text
LARGEST = 2**31 - 1  # of a number without bounds of its own

M = TypeVar("M", bound=_messages.Message)


def write(handle: Any, value: object) -> None:
    """Set an input of a page."""
    handle.value = value


def plain(html: Html) -> str:
    """Convert markup to a plain string: viser's encoder accepts `str`, but not subclasses."""
    return str(html)


def replace_handler(gui: viser.GuiApi, message: type[M], ours: Callable[[ClientId, M], Any]) -> None:
    """Replace viser's handler of a visitor's messages of a type."""
    gui._websock_interface.unregister_handler(message)
    gui._websock_interface.register_handler(message, ours)


def check_inputs(client: viser.ClientHandle, count_refused: Callable[[], None]) -> None:
    """From now on, accept only valid values for inputs of a page."""
    gui = client.gui

    async def update(client_id: ClientId, message: _messages.GuiUpdateMessage) -> None:
        handle = gui._gui_input_handle_from_uuid.get(message.uuid)
        if handle is None:  # just removed from the page
            return
        if takes(handle, message.updates["value"]):
            await gui._handle_gui_updates(client_id, message)
        else:
            count_refused()

    replace_handler(gui, _messages.GuiUpdateMessage, update)


def takes(handle: Any, value: object) -> bool:
    """Return whether a visitor may set an input to a value."""
    if handle.disabled:
        return False
    if isinstance(handle, viser.GuiButtonHandle):
        return value is True
    if isinstance(handle, viser.GuiTextHandle):
        return isinstance(value, str) and len(value) <= LONGEST
    if isinstance(handle, viser.GuiDropdownHandle):
        return value in handle.options
    if isinstance(handle, viser.GuiNumberHandle | viser.GuiSliderHandle):
        low = -LARGEST if handle.min is None else handle.min
        high = LARGEST if handle.max is None else handle.max
        return isinstance(value, int | float) and not isinstance(value, bool) and low <= value <= high
    return False
