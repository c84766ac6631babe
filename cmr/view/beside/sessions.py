"""Visitors of a page beside viser's: each has a process, which alone decides what becomes of what the page says.

This only passes it on, as lines of JSON. Once a page is closed its process hears nothing more, and ends.
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
from cmr.view.wishes import Permission

MOST_BYTES = 600  # of a message
LAST_WORDS = 1000  # bytes of what a process wrote to stderr
PATIENCE = 3.0  # s for a process to end
MOST_READ = 65_536  # bytes at once
MOST_WAITING = 1_000_000  # bytes of what a process said that a page has not taken
WRONG = "This is not the token in the terminal running cmr-view."
WAIT = "Too many wrong tokens came from your address. Wait a minute."


class Entering(msgspec.Struct, forbid_unknown_fields=True, frozen=True, omit_defaults=True):
    """What every page says first: the token."""

    token: Annotated[str, Meta(max_length=256)] | UnsetType = UNSET


Said = TypeVar("Said", bound=Entering)


def decoded(decoder: "msgspec.json.Decoder[Said]", data: Data) -> Said | None:
    """Return what a message says; None if no page says that."""
    if not isinstance(data, str) or len(data) > MOST_BYTES:
        return None
    try:
        return decoder.decode(data)
    except (msgspec.MsgspecError, ValueError, RecursionError):
        return None


class Sessions(ABC, Generic[Said]):
    """Serves a page of `most` visitors at once; `token` is that of the page.

    With `newest_only` a page gets the newest line of its process, and those before are dropped.
    """

    page: str
    title: str
    connects_to: str
    most: int
    full: str  # what is said to those who are too many
    newest_only = False

    def __init__(self, html: Path, token: str, guesses: Guesses) -> None:
        self.html = html.read_bytes()
        self._token, self._guesses = token, guesses
        self._visitors = 0

    @abstractmethod
    def said(self, data: Data) -> Said | None:
        """Return what a message says; None if the page does not say that."""

    @abstractmethod
    def command(self, message: Said) -> list[str] | None:
        """Return how the process is started that a message asks for; None where it asks for none."""

    @abstractmethod
    def line(self, message: Said) -> bytes:
        """Return a message as a line for the process; nothing where it is not for the process."""

    def takes(self, data: Data) -> bool:
        """Return whether this is a message that the page sends."""
        return self.said(data) is not None

    async def serve(self, connection: ServerConnection) -> None:
        """Let a visitor have a process, who knows the token, until the page or the process ends."""
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
        """Return the next message of a page; others do not get through."""
        while True:
            message = self.said(await connection.recv())
            if message is not None:
                return message

    async def _wanted(self, connection: ServerConnection) -> list[str]:
        """Wait for the token, and for what is to be done."""
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
        """Pass on what both say, until one of them ends."""
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
        """Pass on what the page says; a process that takes nothing gets nothing."""
        while True:
            line = self._sessions.line(await self._sessions.heard(self._connection))
            if line:
                with suppress(BlockingIOError, BrokenPipeError):
                    os.write(hands, line)

    async def _pass_back(self) -> None:
        """Pass on what the process says, and what it said last when it ended."""
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
    """Return what has come; nothing where nobody will say anything any more."""
    try:
        return os.read(file, MOST_READ)
    except OSError:
        return b""


async def _say(connection: ServerConnection, **what: object) -> None:
    await connection.send(json.dumps(what))
