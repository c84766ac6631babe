"""Sessions of additional pages: each visitor gets a process, which alone handles the page's messages.

This module only forwards them as lines of JSON. When a page closes, its process gets no more input, and ends.
"""

import asyncio
import json
import os
import subprocess
from abc import ABC, abstractmethod
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Generic, TypeVar

import msgspec
from msgspec import UNSET, Meta, UnsetType
from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosed
from websockets.typing import Data

from cmr.view.entrance.door import address_of
from cmr.view.entrance.guesses import Guesses
from cmr.view.requests import Permission

MOST_BYTES = 600  # of a message
LAST_WORDS = 1000  # bytes of what a process wrote to stderr
PATIENCE = 3.0  # s for a process to end
MOST_READ = 65_536  # bytes at once
MOST_WAITING = 1_000_000  # bytes of a process's output that a page has not received
WRONG = "This is not the token in the terminal running cmr-view."
WAIT = "Too many wrong tokens came from your address. Wait a minute."


class Entering(msgspec.Struct, forbid_unknown_fields=True, frozen=True, omit_defaults=True):
    """The first message of every page: the token."""

    token: Annotated[str, Meta(max_length=256)] | UnsetType = UNSET


Said = TypeVar("Said", bound=Entering)


def decoded(decoder: "msgspec.json.Decoder[Said]", data: Data) -> Said | None:
    """Decode a message; None if it is not one that a page sends."""
    if not isinstance(data, str) or len(data) > MOST_BYTES:
        return None
    try:
        return decoder.decode(data)
    except (msgspec.MsgspecError, ValueError, RecursionError):
        return None


class Sessions(ABC, Generic[Said]):
    """Serves a page for up to `most` visitors at once; `token` is the page's token.

    With `newest_only` a page gets the newest line of its process, and earlier ones are dropped.
    """

    page: str
    title: str
    connects_to: str
    most: int
    full: str  # message when there are too many visitors
    newest_only = False

    def __init__(self, html: Path, token: str, guesses: Guesses) -> None:
        self.html = html.read_bytes()
        self._token, self._guesses = token, guesses
        self._visitors = 0

    @abstractmethod
    def said(self, data: Data) -> Said | None:
        """Decode a message; None if the page does not send such messages."""

    @abstractmethod
    def command(self, message: Said) -> list[str] | None:
        """Return the command of the process that a message requests; None if it requests none."""

    @abstractmethod
    def line(self, message: Said) -> bytes:
        """Convert a message to a line for the process; empty if it is not for the process."""

    def takes(self, data: Data) -> bool:
        """Return whether this is a valid message of the page."""
        return self.said(data) is not None

    async def serve(self, connection: ServerConnection) -> None:
        """Serve a visitor who knows the token with a process, until either ends."""
        with suppress(ConnectionClosed):
            command = await self._wanted(connection)
            if self._visitors >= self.most:
                await _say(connection, ended=self.full)
                return
            self._visitors += 1
            try:
                await _Relay(self, connection, command).run()
            finally:
                self._visitors -= 1

    async def heard(self, connection: ServerConnection) -> Said:
        """Return the next valid message of a page."""
        while True:
            message = self.said(await connection.recv())
            if message is not None:
                return message

    async def _wanted(self, connection: ServerConnection) -> list[str]:
        """Wait for the token, and for the request."""
        permission = Permission(self._token, False, self._guesses, address_of(connection))
        while True:
            message = await self.heard(connection)
            if isinstance(message.token, str):
                granted = permission.try_token(message.token)
                await _say(connection, granted=granted, problem="" if granted else WAIT if permission.wait else WRONG)
            elif permission.granted and (command := self.command(message)) is not None:
                return command


class _Relay(Generic[Said]):
    """One visitor and a process."""

    def __init__(self, sessions: Sessions[Said], connection: ServerConnection, command: list[str]) -> None:
        self._sessions, self._connection = sessions, connection
        pipe = subprocess.PIPE
        self._process = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, start_new_session=True)
        self._lines: list[bytes] = []
        self._rest, self._words = b"", b""
        self._news = asyncio.Event()
        self._over = False

    async def run(self) -> None:
        """Forward messages in both directions until one side ends."""
        loop = asyncio.get_running_loop()
        streams = self._process.stdin, self._process.stdout, self._process.stderr
        hands, lines, words = (stream.fileno() for stream in streams if stream is not None)
        for file in (hands, lines, words):
            os.set_blocking(file, False)
        loop.add_reader(lines, self._take_lines, lines, loop)
        loop.add_reader(words, self._take_words, words, loop)
        tasks = [loop.create_task(self._pass_on(hands)), loop.create_task(self._pass_back())]
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in tasks:
                task.cancel()
            loop.remove_reader(lines)
            loop.remove_reader(words)
            for stream in streams:
                if stream is not None:
                    stream.close()
            await loop.run_in_executor(None, self._bury)
            await asyncio.gather(*tasks, return_exceptions=True)

    async def _pass_on(self, hands: int) -> None:
        """Forward the page's messages; if the process does not read, they are dropped."""
        while True:
            line = self._sessions.line(await self._sessions.heard(self._connection))
            if line:
                with suppress(BlockingIOError, BrokenPipeError):
                    os.write(hands, line)

    async def _pass_back(self) -> None:
        """Forward the process's output, and its last words."""
        while self._lines or not self._over:
            await self._news.wait()
            self._news.clear()
            lines, self._lines = self._lines, []
            for line in lines:
                await self._connection.send(line.decode())
        last = self._words.decode(errors="replace").strip().splitlines()
        await _say(self._connection, ended=last[-1] if last else "The process has ended.")

    def _take_lines(self, file: int, loop: asyncio.AbstractEventLoop) -> None:
        data = _read(file)
        *lines, self._rest = (self._rest + data).split(b"\n")
        self._lines = [*self._lines, *lines][-1 if self._sessions.newest_only else 0 :]
        if not data or sum(map(len, self._lines)) > MOST_WAITING:
            loop.remove_reader(file)
            self._over = True
        self._news.set()

    def _take_words(self, file: int, loop: asyncio.AbstractEventLoop) -> None:
        data = _read(file)
        self._words = (self._words + data)[-LAST_WORDS:]
        if not data:
            loop.remove_reader(file)

    def _bury(self) -> None:
        try:
            self._process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def _read(file: int) -> bytes:
    """Return available output; empty at the end."""
    try:
        return os.read(file, MOST_READ)
    except OSError:
        return b""


async def _say(connection: ServerConnection, **what: object) -> None:
    await connection.send(json.dumps(what))
