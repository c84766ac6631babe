"""Files that a visitor sends to the page: viser's upload, which holds them in memory, with a bound.

Viser itself takes files of any size from anybody. So its handlers of a visitor's transfers are replaced by ones that
refuse before anything is kept.
"""

from collections.abc import Callable
from typing import TypeVar

import viser
from viser import _messages
from viser.infra import ClientId

from cmr.view import words
from cmr.view.opening import RefusedLog

DROP = "Drop an event log, such as run.lcm, anywhere on this page. It is played for you alone."
LAST = 1e18  # in the order of what is on a page, which otherwise is that of time
Check = Callable[[int], None]
Take = Callable[[str, bytes], None]
M = TypeVar("M", bound=_messages.Message)


class Upload:
    """The folder of a page with which its visitor sends a file; a file that is dropped on the page comes here, too.

    It stays when the rest of the page changes, as the browser shows with it how much has been sent. `check(size)`
    raises RefusedLog where a file of this size [bytes] may not be sent, `take(name, content)` where it is not what was
    expected; `refuse(sentence)` says so. `check` and `take` are called by viser's threads.
    """

    def __init__(self, client: viser.ClientHandle, check: Check, take: Take, refuse: Callable[[str], None]) -> None:
        self._gui, self._check, self._take, self._refuse = client.gui, check, take, refuse
        self.folder = client.gui.add_folder("open a log", order=LAST)
        with self.folder:
            client.gui.add_html(words.sentence(DROP))
            self.button = client.gui.add_upload_button("open a log ...", disabled=True, color="gray")
        self.button.on_upload(self._arrived)
        self._replace(_messages.FileTransferStartUpload, self._start)
        self._replace(_messages.FileTransferPart, self._part)

    def allow(self, allowed: bool) -> None:
        """Let the visitor use the button, or not; `check` refuses what comes nevertheless."""
        if self.button.disabled == allowed:
            self.button.disabled = not allowed

    def _replace(self, message: type[M], ours: Callable[[ClientId, M], None]) -> None:
        self._gui._websock_interface.unregister_handler(message)
        self._gui._websock_interface.register_handler(message, ours)

    def _start(self, client_id: ClientId, message: _messages.FileTransferStartUpload) -> None:
        try:
            self._check(message.size_bytes)
        except RefusedLog as refused:
            self._refuse(str(refused))
            self._end_progress(message)
        else:
            self._gui._handle_file_transfer_start(client_id, message)

    def _part(self, client_id: ClientId, message: _messages.FileTransferPart) -> None:
        state = self._gui._current_file_upload_states.get(message.transfer_uuid)
        if state is not None and state["transferred_bytes"] + len(message.content) > state["total_bytes"]:
            self._gui._current_file_upload_states.pop(message.transfer_uuid, None)  # more than was announced
        else:
            self._gui._handle_file_transfer_part(client_id, message)

    def _end_progress(self, message: _messages.FileTransferStartUpload) -> None:
        """Let the browser end its display of progress, and have its button again."""
        self._gui._websock_interface.queue_message(
            _messages.FileTransferPartAck(
                source_component_uuid=message.source_component_uuid,
                transfer_uuid=message.transfer_uuid,
                transferred_bytes=message.size_bytes,
                total_bytes=message.size_bytes,
            )
        )

    def _arrived(self, _event: object) -> None:
        sent = self.button.value
        self.button._impl.value = viser.UploadedFile("", b"")  # or it would stay in memory
        try:
            self._take(sent.name, sent.content)
        except (RefusedLog, OSError) as refused:
            self._refuse(str(refused))


def arriving(client: viser.ClientHandle) -> int:
    """Return how many bytes a visitor is about to send."""
    return sum(state["total_bytes"] for state in list(client.gui._current_file_upload_states.values()))


def clear(client: viser.ClientHandle, kept: viser.GuiFolderHandle) -> None:
    """Take everything from a visitor's page but one folder, and everything from the scene."""
    for handle in list(client.gui._container_handle_from_uuid["root"]._children.values()):
        if handle is not kept:
            handle.remove()
    for command in list(client.gui._command_handle_from_uuid.values()):
        command.remove()
    client.scene.reset()
