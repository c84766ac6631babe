"""Pseudo-terminals that look like serial ports: a stable name in a folder, and non-blocking I/O."""

import contextlib
import errno
import fcntl
import os
import select
import termios
import tty
from pathlib import Path
from types import TracebackType

READ_SIZE = 4096  # bytes; what the kernel holds for a pseudo-terminal
DEFAULT_FOLDER = "cmr-robot-"  # and the number of the robot, among the temporary files


class PortsError(Exception):
    """The ports cannot be created; the text says why and what to do."""


class PseudoTerminal:
    """One serial port, from the device's side, behind the symbolic link `path`. It never blocks.

    Like a real port it keeps nothing for a client that opens it later: bytes sent while it is closed are lost, and so
    is one client's claim to have it alone (TIOCEXCL). Raises PortsError if something that is not a symbolic link is at
    `path`, OSError if no port can be created.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._was_open = False
        self._kept = b""  # last bytes of a client whose port had to be created again
        self._make()

    def fileno(self) -> int:
        """Return the file descriptor to wait on while `is_open`; a closed port is always readable."""
        return self._descriptor

    @property
    def is_open(self) -> bool:
        """Return whether a client has the port open."""
        is_open = self._has_client()
        if self._was_open and not is_open:
            self._forget_client()
            is_open = self._has_client()
        self._was_open = is_open
        return is_open

    def read(self) -> bytes:
        """Return what the client has sent; nothing if it has sent nothing."""
        kept, self._kept = self._kept, b""
        try:
            return kept + os.read(self._descriptor, READ_SIZE)
        except OSError as error:
            if error.errno in (errno.EAGAIN, errno.EIO):  # EIO: no client has the port open
                return kept
            raise

    def write(self, data: bytes) -> None:
        """Send to the client. Bytes that do not fit because it does not read are lost, as on a real line."""
        if self.is_open:
            with contextlib.suppress(BlockingIOError):
                os.write(self._descriptor, data)

    def close(self) -> None:
        """Remove the port and its link; a client that has it open sees the device vanish."""
        unlink(self._path, self._name)
        os.close(self._descriptor)

    def _make(self) -> None:
        self._descriptor, client_side = os.openpty()
        self._name = os.ttyname(client_side)
        tty.setraw(client_side)
        # Without a client side open in this process, the kernel reports a hang-up whenever no client has the port open.
        os.close(client_side)
        os.set_blocking(self._descriptor, False)
        self._poll = select.poll()
        self._poll.register(self._descriptor, select.POLLIN)
        link(self._path, self._name)

    def _has_client(self) -> bool:
        return not any(events & select.POLLHUP for _, events in self._poll.poll(0))

    def _forget_client(self) -> None:
        """Discard the last client's unread bytes and its claim; only the client's side can do that."""
        try:
            client_side = os.open(self._name, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        except OSError as error:
            if error.errno == errno.EBUSY and not self._has_client():
                # The claim outlives the client on a pseudo-terminal, unlike on a real port: create a new one.
                self._kept = self.read()
                os.close(self._descriptor)
                self._make()
            return
        fcntl.ioctl(client_side, termios.TIOCNXCL)
        termios.tcflush(client_side, termios.TCIFLUSH)
        os.close(client_side)


class Ports:
    """Pseudo-terminals by name, each behind a symbolic link `folder/name`; a context manager.

    The links are removed at the end, and the folder too if it was created here and is empty. Raises PortsError if the
    folder cannot be used or another emulator uses it.
    """

    def __init__(self, folder: Path, names: tuple[str, ...]) -> None:
        self.paths = {name: folder / name for name in names}
        self.terminals: dict[str, PseudoTerminal] = {}
        self._folder = folder
        self._resources = contextlib.ExitStack()

    def __enter__(self) -> "Ports":
        with contextlib.ExitStack() as resources:
            try:
                self._take_folder(resources)
                for name, path in self.paths.items():
                    self.terminals[name] = PseudoTerminal(path)
                    resources.callback(self.terminals[name].close)
            except OSError as error:
                raise PortsError(f"Cannot offer ports in {self._folder}: {error}. Choose another --ports.") from error
            self._resources = resources.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._resources.close()

    def _take_folder(self, resources: contextlib.ExitStack) -> None:
        """Create the folder if needed and lock it: two emulators must not replace each other's links."""
        is_new = not self._folder.exists()
        self._folder.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(self._folder, os.O_RDONLY | os.O_DIRECTORY)
        resources.callback(os.close, descriptor)
        if is_new:
            resources.callback(_remove_if_empty, self._folder)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise PortsError(f"Another emulator has its ports in {self._folder}. Choose another --ports.") from error
        left = self._left_behind()
        for path in left:
            path.unlink(missing_ok=True)
        if left and not is_new and self._folder.name.startswith(DEFAULT_FOLDER):  # created by an earlier emulator
            resources.callback(_remove_if_empty, self._folder)

    def _left_behind(self) -> list[Path]:
        """Return the links of an emulator that was killed; none if the folder holds anything else."""
        paths = list(self._folder.iterdir())
        names = {path: path.name.removeprefix(".").partition(".")[0] for path in paths}
        are_ours = all(path.is_symlink() and name in self.paths for path, name in names.items())
        return paths if are_ours else []


def link(path: Path, target: str) -> None:
    """Point the symbolic link `path` at `target` in one step, so that a client never finds half a link.

    Raises PortsError if something that is not a symbolic link is in the way.
    """
    if path.exists() and not path.is_symlink():
        raise PortsError(f"{path} exists and is not a link of an emulator. Move it away or choose another --ports.")
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    temporary.symlink_to(target)
    temporary.replace(path)


def unlink(path: Path, target: str) -> None:
    """Remove the symbolic link `path` if it still points at `target`."""
    with contextlib.suppress(OSError):
        if path.readlink() == Path(target):
            path.unlink()


def _remove_if_empty(folder: Path) -> None:
    with contextlib.suppress(OSError):
        folder.rmdir()
