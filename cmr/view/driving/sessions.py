"""Visitors who drive: each has a process of cmr-teleop, which alone decides what becomes of what the page says.

This only passes it on. Messages that are held up on the way, here or in the network, are old by the beats that they
repeat, and move nothing (`cmr.teleop.remote`). Once a page is closed its process hears nothing more, and ends.
"""

import asyncio
import json
import os
import subprocess
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from msgspec import UNSET
from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosed
from websockets.typing import Data

from cmr.view.driving.said import Said, line, said
from cmr.view.entrance.door import address_of
from cmr.view.entrance.guesses import Guesses
from cmr.view.wishes import Permission

PAGE, HANDS = "/drive", "/drive/hands"  # the page, and what it connects to
HTML = Path(__file__).with_name("drive.html")
MOST_DRIVERS = 4  # processes at once
LAST_WORDS = 1000  # bytes of what a process wrote to stderr
PATIENCE = 3.0  # s for a process to end
MOST_READ = 65_536  # bytes at once
FULL = f"{MOST_DRIVERS} pages drive already."
WRONG = "This is not the token in the terminal running cmr-view."
WAIT = "Too many wrong tokens came from your address. Wait a minute."

Command = Callable[[int, bool], list[str]]  # of cmr-teleop, for a robot, which may be taken over


class Sessions:
    """Serves the page with the joystick; `command` returns how cmr-teleop is started, `token` is that of the page."""

    page, connects_to = PAGE, HANDS

    def __init__(self, token: str, command: Command, guesses: Guesses) -> None:
        self.html = HTML.read_bytes()
        self._token, self._command, self._guesses = token, command, guesses
        self._drivers = 0

    def takes(self, data: Data) -> bool:
        """Return whether this is a message that the page sends."""
        return said(data) is not None

    async def serve(self, connection: ServerConnection) -> None:
        """Let a visitor drive, who knows the token, until the page or the process ends."""
        with suppress(ConnectionClosed):
            wanted = await self._wanted(connection)
            if wanted is None:
                await _say(connection, ended=FULL)
                return
            self._drivers += 1
            try:
                await _Ride(connection, self._command(*wanted)).run()
            finally:
                self._drivers -= 1

    async def _wanted(self, connection: ServerConnection) -> tuple[int, bool] | None:
        """Wait for the token, and for the robot to drive; None where too many drive already."""
        permission = Permission(self._token, False, self._guesses, address_of(connection))
        while True:
            message = await _heard(connection)
            if isinstance(message.token, str):
                granted = permission.try_token(message.token)
                await _say(connection, granted=granted, problem="" if granted else WAIT if permission.wait else WRONG)
            elif permission.granted and isinstance(message.robot, int):
                return (message.robot, message.take_over) if self._drivers < MOST_DRIVERS else None


class _Ride:
    """One visitor and a process of cmr-teleop."""

    def __init__(self, connection: ServerConnection, command: list[str]) -> None:
        self._connection = connection
        pipe = subprocess.PIPE
        self._process = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, start_new_session=True)
        self._beat, self._rest, self._words = b"", b"", b""
        self._news = asyncio.Event()
        self._over = False

    async def run(self) -> None:
        """Pass on what both say, until one of them ends."""
        loop = asyncio.get_running_loop()
        streams = self._process.stdin, self._process.stdout, self._process.stderr
        hands, beats, words = (stream.fileno() for stream in streams if stream is not None)
        for file in (hands, beats, words):
            os.set_blocking(file, False)
        loop.add_reader(beats, self._take_beat, beats, loop)
        loop.add_reader(words, self._take_words, words, loop)
        tasks = [loop.create_task(self._pass_on(hands)), loop.create_task(self._pass_back())]
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in tasks:
                task.cancel()
            loop.remove_reader(beats)
            loop.remove_reader(words)
            for stream in streams:
                if stream is not None:
                    stream.close()
            await loop.run_in_executor(None, self._bury)
            await asyncio.gather(*tasks, return_exceptions=True)

    async def _pass_on(self, hands: int) -> None:
        """Pass on what the page says; a process that takes nothing gets nothing, and no robot moves."""
        while True:
            message = await _heard(self._connection)
            if message.beat is not UNSET or message.wish is not UNSET:
                with suppress(BlockingIOError, BrokenPipeError):
                    os.write(hands, line(message))

    async def _pass_back(self) -> None:
        """Pass on the newest beat, and what the process said last when it ended."""
        while not self._over:
            await self._news.wait()
            self._news.clear()
            beat, self._beat = self._beat, b""
            if beat:
                await self._connection.send(beat.decode())
        last = self._words.decode(errors="replace").strip().splitlines()
        await _say(self._connection, ended=last[-1] if last else "cmr-teleop has ended.")

    def _take_beat(self, file: int, loop: asyncio.AbstractEventLoop) -> None:
        data = _read(file)
        *lines, self._rest = (self._rest + data).split(b"\n")
        self._beat = lines[-1] if lines else self._beat
        if not data:
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


async def _heard(connection: ServerConnection) -> Said:
    """Return the next message of a page; others do not get through."""
    while True:
        message = said(await connection.recv())
        if message is not None:
            return message


async def _say(connection: ServerConnection, **what: object) -> None:
    await connection.send(json.dumps(what))
