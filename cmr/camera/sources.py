"""Sources of pictures: a USB camera, the address of a stream, a video file, or a folder of pictures."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".webp")
FIRST_UTIME = 1_000_000_000_000_000  # us; a picture whose name is a number from this on was taken at that time
OLDEST = 1.0  # s; a time stamp of the camera that is older comes from another clock
CODES = {".mp4": "mp4v", ".mkv": "mp4v", ".avi": "MJPG"}  # of videos, by the file's suffix
LONGEST_GAP = 10.0  # s; after a longer one a video goes on at once
PATIENCE = 10.0  # s to wait for a network camera; its first complete picture takes a while
LATE = 1.0  # s by which playback may lag; above, it resumes from there instead of catching up


class SourceError(Exception):
    """Pictures cannot be read; the text says why, and what to do."""


class Taken(NamedTuple):
    """A picture, blue-green-red, and its time of exposure [us since the Unix epoch]."""

    utime: int
    picture: NDArray[np.uint8]


class Camera:
    """A USB camera by its number, or a network camera by its address. `lag` [s] is the delay from exposure to time
    stamp.

    Pictures of a USB camera are stamped by the kernel when taken, those of a network camera only on arrival. Raises
    SourceError if the camera cannot be opened.
    """

    ends = False

    def __init__(self, what: int | str, size: tuple[int, int], rate: float, lag: float) -> None:
        self.what, self.lag = what, lag
        self._is_usb = isinstance(what, int)
        self._capture = _usb_camera(what) if isinstance(what, int) else _network_camera(what)
        if self._is_usb:
            settings = (
                (cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*"MJPG")),  # raw pictures do not fit USB 2 at full rate
                *((cv2.CAP_PROP_FRAME_WIDTH, size[0]), (cv2.CAP_PROP_FRAME_HEIGHT, size[1])),
                *((cv2.CAP_PROP_FPS, rate), (cv2.CAP_PROP_BUFFERSIZE, 1)),
            )
            for name, value in settings:
                self._capture.set(name, value)

    def read(self) -> Taken:
        """Wait for the next picture. Raises SourceError when the camera is gone."""
        there, picture = self._capture.read()
        arrived, ticks = time.time(), time.monotonic()
        if not there:
            raise SourceError(f"The camera {self.what} has stopped sending pictures.")
        stamp = self._capture.get(cv2.CAP_PROP_POS_MSEC) / 1e3 if self._is_usb else 0.0
        age = ticks - stamp if 0.0 <= ticks - stamp < OLDEST else 0.0
        return Taken(int((arrived - age - self.lag) * 1e6), np.asarray(picture, np.uint8))

    def close(self) -> None:
        """Release the camera."""
        self._capture.release()


def _usb_camera(number: int) -> "cv2.VideoCapture":
    capture = cv2.VideoCapture(number, cv2.CAP_V4L2)
    if not capture.isOpened():
        known = ", ".join(sorted(path.name.removeprefix("video") for path in Path("/dev").glob("video*")))
        there = f"there are: {known}" if known else "there is none"
        raise SourceError(f"The camera {number} cannot be opened; {there}.")
    return capture


def _network_camera(address: str) -> "cv2.VideoCapture":
    patience = int(1e3 * PATIENCE)
    limits = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, patience, cv2.CAP_PROP_READ_TIMEOUT_MSEC, patience]
    capture = cv2.VideoCapture(address, cv2.CAP_FFMPEG, limits)
    if not capture.isOpened():
        complaint = (
            f"does not send pictures within {PATIENCE:.0f} s. Is the address right, is it on, and in this network?"
        )
        raise SourceError(f"The camera {address} {complaint}")
    return capture


class Film:
    """A video file or a folder of pictures, at its own pace, or as fast as possible (`hurry`).

    Pictures in a folder whose names are numbers of microseconds since 1970 were taken then; all others, and those of a
    video, were taken as if the first were taken now, `rate` of them a second in a folder.
    Raises SourceError when there is nothing to show.
    """

    ends = True

    def __init__(self, path: Path, rate: float, *, hurry: bool = False, wait: Callable[[float], None] = time.sleep):
        self._hurry, self._wait = hurry, wait
        self._frames = _Folder(path, rate) if path.is_dir() else _Video(path)
        self._begun: float | None = None
        self._first = 0

    def read(self) -> Taken | None:
        """Wait for the next picture's moment and return it, None after the last. Raises SourceError."""
        frame = self._frames.next()
        if frame is None:
            return None
        utime, picture = frame
        if self._begun is None:
            self._begun, self._first = time.monotonic(), utime
            self._offset = 0 if utime >= FIRST_UTIME else time.time_ns() // 1000 - utime
        due = self._begun + (utime - self._first) / 1e6 - time.monotonic()
        if not self._hurry and due > 0.0:
            self._wait(due)
        elif due < -LATE:
            self._begun -= due
        return Taken(utime + self._offset, picture)

    def close(self) -> None:
        """Close the file."""
        self._frames.close()


class _Folder:
    """The pictures of a folder in order of their names."""

    def __init__(self, path: Path, rate: float) -> None:
        self._paths = sorted(file for file in path.iterdir() if file.suffix.lower() in SUFFIXES)
        if not self._paths:
            raise SourceError(f"There are no pictures in {path}; known are {', '.join(SUFFIXES)}.")
        names = [file.stem for file in self._paths]
        self._are_times = all(name.isdecimal() and int(name) >= FIRST_UTIME for name in names)
        if self._are_times:
            self._paths.sort(key=lambda file: int(file.stem))
        self._rate, self._next = rate, 0

    def next(self) -> Taken | None:
        if self._next == len(self._paths):
            return None
        path = self._paths[self._next]
        picture = cv2.imread(str(path), cv2.IMREAD_COLOR)
        if picture is None:
            raise SourceError(f"{path} is no picture.")
        utime = int(path.stem) if self._are_times else round(self._next * 1e6 / self._rate)
        self._next += 1
        return Taken(utime, np.asarray(picture, np.uint8))

    def close(self) -> None:
        self._paths = []


class _Video:
    """The pictures of a video file."""

    def __init__(self, path: Path) -> None:
        self._capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
        if not path.is_file() or not self._capture.isOpened():
            raise SourceError(f"{path} is neither a video nor a folder of pictures.")

    def next(self) -> Taken | None:
        there, picture = self._capture.read()
        utime = round(self._capture.get(cv2.CAP_PROP_POS_MSEC) * 1e3)
        return Taken(utime, np.asarray(picture, np.uint8)) if there else None

    def close(self) -> None:
        self._capture.release()


def open_source(what: str, size: tuple[int, int], rate: float, lag: float, *, hurry: bool = False) -> Camera | Film:
    """Return the source of pictures that the command line names. Raises SourceError."""
    if what.isdecimal():
        return Camera(int(what), size, rate, lag)
    if "://" in what:
        return Camera(what, size, rate, lag)
    return Film(Path(what), rate, hurry=hurry)


class Video:
    """Writes pictures into a video of constant rate [Hz]; each is repeated until the time of the next one.

    Raises SourceError when the file cannot be written.
    """

    def __init__(self, path: Path, rate: float) -> None:
        if path.suffix.lower() not in CODES:
            raise SourceError(f"{path}: a video's name ends with {', '.join(CODES)}.")
        self._path, self._rate = path, rate
        self._writer: cv2.VideoWriter | None = None
        self._first = self._written = 0
        self._size = (0, 0)

    def take(self, taken: Taken) -> None:
        """Write a picture. Raises SourceError."""
        height, width = taken.picture.shape[:2]
        if self._writer is None:
            code = cv2.VideoWriter.fourcc(*CODES[self._path.suffix.lower()])
            self._writer = cv2.VideoWriter(str(self._path), cv2.CAP_FFMPEG, code, self._rate, (width, height))
            if not self._writer.isOpened():
                raise SourceError(f"The video {self._path} cannot be written.")
            self._first, self._size = taken.utime, (width, height)
        wanted = round((taken.utime - self._first) / 1e6 * self._rate) + 1
        if not 0 <= wanted - self._written <= LONGEST_GAP * self._rate:
            self._first = taken.utime - round(self._written / self._rate * 1e6)
            wanted = self._written + 1
        if (width, height) == self._size:
            for _ in range(wanted - self._written):
                self._writer.write(taken.picture)
            self._written = max(self._written, wanted)

    def close(self) -> None:
        """Complete and close the file."""
        if self._writer is not None:
            self._writer.release()
            self._writer = None
