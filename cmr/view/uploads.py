"""Files uploaded by visitors: written to disk part by part, within limits.

Viser itself accepts files of any size from anybody, in memory. So its handlers of uploads are replaced.
"""

import time
from collections.abc import Callable
from typing import BinaryIO, NamedTuple

import viser
from viser import _messages
from viser.infra import ClientId

from cmr.view import words
from cmr.view.inputs import replace_handler
from cmr.view.opening import LogFolder, OpenedLog, RefusedLog

DROP = "Drop an event log, such as run.lcm, anywhere on this page. It is played for you alone."
LAST = 1e18  # position on a page, which is otherwise by time
SILENCE = 30.0  # s without data after which an upload is given up
Check = Callable[[int], None]
Take = Callable[[OpenedLog], None]


class _Transfer(NamedTuple):
    """An upload in progress, in parts [bytes] that must arrive in order; `received` of them have."""

    start: _messages.FileTransferStartUpload
    stream: BinaryIO
    received: int
    heard: float


class Upload:
    """The upload folder of a page; files dropped on the page also arrive here.

    It stays when the rest of the page changes, because the browser shows the progress with it. `check(size)` raises
    RefusedLog for a file size [bytes] that is not allowed; `take(log)` gets a complete log, in `logs`;
    `refuse(sentence)` reports a refusal. They are called from viser's threads.
    """

    def __init__(
        self, client: viser.ClientHandle, logs: LogFolder, check: Check, take: Take, refuse: Callable[[str], None]
    ) -> None:
        self._gui, self._logs, self._check, self._take, self._refuse = client.gui, logs, check, take, refuse
        self._transfer: _Transfer | None = None
        self.folder = client.gui.add_folder("open a log", order=LAST)
        with self.folder:
            client.gui.add_html(words.sentence(DROP))
            self.button = client.gui.add_upload_button("open a log ...", disabled=True, color="gray")
        replace_handler(self._gui, _messages.FileTransferStartUpload, self._start)
        replace_handler(self._gui, _messages.FileTransferPart, self._part)

    @property
    def arriving(self) -> int:
        """The number of bytes that the visitor is sending."""
        transfer = self._transfer
        if transfer is None or time.monotonic() - transfer.heard > SILENCE:
            return 0
        return transfer.start.size_bytes

    def allow(self, allowed: bool) -> None:
        """Enable or disable the button; `check` refuses anything sent anyway."""
        if self.button.disabled == allowed:
            self.button.disabled = not allowed

    def end(self) -> None:
        """Discard an incomplete upload."""
        transfer, self._transfer = self._transfer, None
        if transfer is not None:
            self._logs.drop(transfer.stream)

    def _start(self, _client_id: ClientId, message: _messages.FileTransferStartUpload) -> None:
        self.end()
        try:
            self._check(message.size_bytes)
            self._logs.check_room(message.size_bytes)
            self._transfer = _Transfer(message, self._logs.begin(), 0, time.monotonic())
        except (RefusedLog, OSError) as refused:
            self._give_up(message, _sentence(refused))
        else:
            if message.part_count == 0:
                self._finish(self._transfer)

    def _part(self, _client_id: ClientId, message: _messages.FileTransferPart) -> None:
        transfer = self._transfer
        if transfer is None or message.transfer_uuid != transfer.start.transfer_uuid:
            return
        start, done = transfer.start, transfer.stream.tell() + len(message.content)
        is_last = transfer.received + 1 == start.part_count
        fits = done == start.size_bytes if is_last else done < start.size_bytes
        if message.part_index != transfer.received or not message.content or not fits:
            self.end()  # not how a page sends a file
            return
        try:
            transfer.stream.write(message.content)
        except OSError as error:
            self._give_up(start, _sentence(error))
            return
        self._transfer = transfer._replace(received=transfer.received + 1, heard=time.monotonic())
        self._acknowledge(start, done)
        if is_last:
            self._finish(self._transfer)

    def _finish(self, transfer: _Transfer) -> None:
        """Check a file in another thread, because it takes a moment."""
        self._transfer = None
        self._gui._thread_executor.submit(self._arrived, transfer)

    def _arrived(self, transfer: _Transfer) -> None:
        try:
            self._take(self._logs.keep(transfer.start.filename, transfer.stream))
        except (RefusedLog, OSError) as refused:
            self._refuse(_sentence(refused))

    def _give_up(self, start: _messages.FileTransferStartUpload, sentence: str) -> None:
        self.end()
        self._refuse(sentence)
        self._acknowledge(start, start.size_bytes)  # the browser then ends its progress display

    def _acknowledge(self, start: _messages.FileTransferStartUpload, done: int) -> None:
        self._gui._websock_interface.queue_message(
            _messages.FileTransferPartAck(
                source_component_uuid=start.source_component_uuid,
                transfer_uuid=start.transfer_uuid,
                transferred_bytes=done,
                total_bytes=start.size_bytes,
            )
        )


def _sentence(refused: Exception) -> str:
    if isinstance(refused, OSError):
        return f"The log cannot be kept here: {refused.strerror or refused}."
    return str(refused)


def clear(client: viser.ClientHandle, kept: viser.GuiFolderHandle) -> None:
    """Remove everything from a visitor's page except one folder, and everything from the scene."""
    for handle in list(client.gui._container_handle_from_uuid["root"]._children.values()):
        if handle is not kept:
            handle.remove()
    for command in list(client.gui._command_handle_from_uuid.values()):
        command.remove()
    client.scene.reset()
