"""cmr-camera: AprilTags in, virtual robots out. A camera over the floor locates robots and shows the mixed world."""

import argparse
import os
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from cmr.bus.message import Message
from cmr.bus.messages import make
from cmr.bus.process import Process, Timer
from cmr.bus.senders import keep
from cmr.bus.streams import CAMERA_IMAGE, POSE, WAYPOINTS, WORLD_STATE
from cmr.camera.paper import PAPERS
from cmr.cli.command_line import parse_number, parse_seconds, parser
from cmr.cli.errors import CommandError
from cmr.cli.progress import Progress
from cmr.distribution import how_to_install
from cmr.msg import camera_image_t, pose_xyt_t, process_status_t, waypoints_t, world_state_t

if TYPE_CHECKING:
    from cmr.camera.drawing import Picture
    from cmr.camera.lens import Lens
    from cmr.camera.place import Place
    from cmr.camera.sources import Camera, Film, Video
    from cmr.camera.watcher import Watcher
    from cmr.camera.watching import Seen, Watching

TURN_RATE = 100.0  # Hz at which results of the camera's thread are published
FLOOR_EXAMPLE = """\
A floor file (m, rad; theta is where a tag's top points; a robot's tag has the
robot's id as number, and its top points ahead):
  schema: 1
  tag_size: 0.16               # edge of the black square
  tags:                        # on the floor: four or more, far apart
    100: {x: -1.2, y: -0.6, theta: 1.571}
    101: {x: 1.2, y: -0.6, theta: 1.571}
    102: {x: 1.2, y: 0.7, theta: 1.571}
    103: {x: -1.2, y: 0.7, theta: 1.571}
  robots:                      # all of it may be left out
    each: {height: 0.1, length: 0.2, width: 0.2}
    7: {x: 0.02, theta: 1.571, robot_id: 3}   # tag 7, mounted askew, on robot 3
    only: [0, 1, 7]            # other tags count nothing
"""


def main(arguments: list[str]) -> int:
    """Run cmr-camera."""
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")  # errors are reported here, in a sentence
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    commands: dict[str, Callable[[list[str]], int]] = {"calibrate": _calibrate, "board": _board, "tags": _tags}
    try:
        if arguments and arguments[0] in commands:
            return commands[arguments[0]](arguments[1:])
        return _watch(command_parser().parse_args(arguments))
    except ModuleNotFoundError as error:
        if error.name != "cv2":
            raise
        raise CommandError(f"OpenCV is missing. To install it: {how_to_install('camera')}") from error


def command_parser() -> argparse.ArgumentParser:
    """Return the command line of cmr-camera."""
    options = parser(
        "cmr-camera",
        "Locate robots by AprilTags (36h11) with a camera over the floor, publish POSE_N, and show virtual robots in "
        "the camera's picture on CAMERA_IMAGE.\n\n"
        "Print tags and board first (cmr-camera tags, cmr-camera board), calibrate the lens once "
        "(cmr-camera calibrate), and write down where the floor's tags lie.",
        "cmr-camera tags 0-3,100-103 --size 0.16\n  cmr-camera board\n  cmr-camera calibrate 0\n"
        "  cmr-camera 0 --floor floor.yaml --lens lens.yaml\n"
        "  cmr-camera rtsp://10.0.0.7/stream --floor floor.yaml --record run.mkv\n\n" + FLOOR_EXAMPLE,
    )
    _add_source(options)
    options.add_argument("--floor", type=Path, default=Path("floor.yaml"), metavar="FILE", help="where the tags are")
    options.add_argument("--lens", type=Path, default=Path("lens.yaml"), metavar="FILE", help="of cmr-camera calibrate")
    options.add_argument("--name", default="camera", metavar="TEXT", help="of this camera in CAMERA_IMAGE")
    options.add_argument(
        "--lag", type=parse_seconds, default=0.0, metavar="S", help="from exposure to the time stamp of a picture"
    )
    options.add_argument(
        "--image-rate", type=_rate, default=10.0, metavar="HZ", help="of CAMERA_IMAGE and --record; 0: no pictures"
    )
    options.add_argument("--quality", type=int, choices=range(1, 101), default=80, metavar="1-100", help="of the JPEGs")
    options.add_argument("--trail", type=parse_seconds, default=3.0, metavar="S", help="of virtual robots")
    options.add_argument("--plain", action="store_true", help="show the picture as it is, without virtual robots")
    options.add_argument("--record", type=Path, metavar="FILE", help="what is shown, as .mkv, .mp4 or .avi")
    return options


def _add_source(options: argparse.ArgumentParser) -> None:
    options.add_argument(
        "source",
        metavar="SOURCE",
        help="number of a USB camera, address of a stream, video file, or folder of pictures",
    )
    options.add_argument("--size", type=_size, default="1280x720", metavar="WxH", help="of a USB camera's pictures")
    options.add_argument("--rate", type=_rate, default=30.0, metavar="HZ", help="of a USB camera, or of a folder")


def _watch(options: argparse.Namespace) -> int:
    """Watch a camera until the end of its pictures, or a signal."""
    _with_one_thread()
    from cmr.camera.floor import Floor
    from cmr.camera.lens import CameraFileError, Lens
    from cmr.camera.sources import SourceError, Video, open_source
    from cmr.camera.watcher import Watcher
    from cmr.camera.watching import Watching

    _check_files(options)
    with Process("cmr-camera", options.lcm_url) as process:
        try:
            watcher = Watcher(Lens.load(options.lens), Floor.load(options.floor))
            video = Video(options.record, options.image_rate or 1.0) if options.record else None

            def opened() -> "Camera | Film":
                return open_source(options.source, options.size, options.rate, options.lag)

            watching = Watching(opened(), opened, watcher)
            showing = _Showing(process, watcher, video, options)
        except (CameraFileError, SourceError, OSError) as error:
            raise CommandError(str(error)) from error
        try:
            _loop(process, watching, showing)
        except SourceError as error:
            raise CommandError(str(error)) from error
        finally:
            watching.close()
            if video:
                video.close()
    print(_summary(watching.pictures, showing))
    return process.exit_code


def _with_one_thread() -> None:
    """Limit OpenCV to one thread: more hardly speed up a picture, and slow down other processes."""
    import cv2

    cv2.setNumThreads(1)


def _check_files(options: argparse.Namespace) -> None:
    """Raise CommandError if a required file is missing."""
    if not options.lens.exists():
        raise CommandError(f"There is no {options.lens}. 'cmr-camera calibrate' makes it from pictures of the board.")
    if not options.floor.exists():
        raise CommandError(f"There is no {options.floor}, which says where tags lie. 'cmr-camera --help' shows one.")


def _summary(pictures: int, showing: "_Showing") -> str:
    """Return a summary of what was seen."""
    seen = ", ".join(f"robot {robot_id} in {count}" for robot_id, count in sorted(showing.seen.items()))
    return " ".join([f"{pictures} pictures: {seen or 'no robot seen'}.", *showing.not_taken()])


def _loop(process: Process, watching: "Watching", showing: "_Showing") -> None:
    """Publish what is seen until the pictures end, or a signal. Raises SourceError if they end too soon."""
    from cmr.camera.sources import SourceError

    summary = Timer(1.0)
    for _utime in process.loop(rate_hz=TURN_RATE):
        process.dispatch(showing.handle)
        for seen in watching.results():
            showing.publish(seen)
        if summary.due():
            _tell(process, watching, showing)
        if watching.done:
            break
    if watching.failed and not process.stopped_by_signal:
        raise SourceError(watching.problem)


class _Showing:
    """Publishes what the camera saw, and its picture with virtual objects drawn into it."""

    def __init__(
        self, process: Process, watcher: "Watcher", video: "Video | None", options: argparse.Namespace
    ) -> None:
        from cmr.camera.drawing import Drawer, Waypoints
        from cmr.camera.tracks import Tracks
        from cmr.camera.watching import Latency

        self.latency = Latency()
        self.seen: Counter[int] = Counter()  # pictures with this robot
        self.watcher = watcher
        self._process, self._video, self._options = process, video, options
        self._tracks = Tracks(int(options.trail * 1e6))
        self._drawer = Drawer(watcher.lens, watcher.floor.usual)
        self._make_waypoints = Waypoints
        self._waypoints: dict[str, Waypoints] = {}
        self._due = 0  # us; time of the next picture to show
        process.subscribe(WORLD_STATE, every=True)
        process.subscribe(WAYPOINTS)

    def handle(self, utime: int, channel: str, message: Message) -> None:
        """Handle a message from the bus."""
        if isinstance(message, world_state_t):
            self._tracks.handle(utime, message)
        elif isinstance(message, waypoints_t):
            keep(self._waypoints, channel, self._make_waypoints(list(message.x), list(message.y)))

    def publish(self, seen: "Seen") -> None:
        """Publish the poses in a picture, and the picture if it is time for one."""
        utime = seen.taken.utime
        self.seen.update(seen.poses.keys())
        for robot_id, pose in seen.poses.items():
            message = make(pose_xyt_t, utime=utime, robot_id=robot_id, x=pose.x, y=pose.y, theta=pose.theta)
            self._process.publish(POSE, message, robot_id)
            self.latency.take(utime)
        period = 1e6 / self._options.image_rate if self._options.image_rate else 0.0
        if period and not -2.0 * period < utime - self._due < 0.0:  # due, or the clock was set back
            on_time = 0.0 <= utime - self._due < period
            self._due = (self._due if on_time else utime) + int(period)
            self._show(seen)

    def not_taken(self) -> list[str]:
        """Return a sentence on ignored tags, if there are any."""
        rejected = ", ".join(f"{reason} {count}" for reason, count in sorted(self.watcher.rejected.items()))
        return [f"Tags not taken: {rejected}."] if rejected else []

    def _show(self, seen: "Seen") -> None:
        import cv2

        from cmr.camera.sources import Taken

        utime, picture = seen.taken
        if seen.place is not None and not self._options.plain:
            picture = self._drawn(seen, seen.place)
        if self._video:
            self._video.take(Taken(utime, picture))
        done, jpeg = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, self._options.quality])
        if done:
            height, width = picture.shape[:2]
            image = make(
                camera_image_t, utime=utime, camera=self._options.name, width=width, height=height, jpeg=jpeg.tobytes()
            )
            self._process.publish(CAMERA_IMAGE, image)

    def _drawn(self, seen: "Seen", place: "Place") -> "Picture":
        """Return the picture with the virtual robots of its time; real ones are where the camera sees them."""
        from cmr.camera.tracks import REAL, VIRTUAL, Shown

        utime, floor = seen.taken.utime, self.watcher.floor
        real = {robot.robot_id: robot for robot in self._tracks.at(utime, REAL)}
        for robot_id, pose in seen.poses.items():
            real[robot_id] = Shown(robot_id, pose.x, pose.y, pose.theta, [])
        boxes = [(robot, floor.robot_tag(floor.number(robot.robot_id))) for robot in real.values()]
        virtual = self._tracks.at(utime, VIRTUAL)
        return self._drawer.draw(seen.taken.picture, place, virtual, boxes, self._waypoints.values())


def _tell(process: Process, watching: "Watching", showing: _Showing) -> None:
    """Report latency, rejections, and what is wrong."""
    process.state = process_status_t.DEGRADED if watching.problem else process_status_t.RUNNING
    sentences = [watching.problem, showing.latency.summary(), *showing.not_taken()]
    process.message = " ".join(sentence for sentence in sentences if sentence)


def _calibrate(arguments: list[str]) -> int:
    """Find the lens from pictures of the printed board."""
    options = parser(
        "cmr-camera calibrate",
        "Find the lens from pictures of the printed board (cmr-camera board): hold it before the camera near and far, "
        "in all corners of the picture, and tilted to all sides.",
        "cmr-camera calibrate 0 --out lens.yaml\n  cmr-camera calibrate pictures/",
    )
    _add_source(options)
    options.add_argument(
        *("--out", "--lens"), dest="out", type=Path, default=Path("lens.yaml"), metavar="FILE", help="to write"
    )
    options.add_argument("--pictures", type=int, default=25, metavar="N", help="of a camera: how many with the board")
    options.add_argument("--every", type=parse_seconds, default=1.0, metavar="S", help="of a camera: one so often")
    chosen = options.parse_args(arguments)
    _with_one_thread()
    from cmr.camera.lens_fit import LensError
    from cmr.camera.sources import SourceError

    try:
        lens = _fitted(chosen)
        lens.save(chosen.out)
    except (LensError, SourceError, OSError) as error:
        raise CommandError(str(error)) from error
    print(f"focal length {lens.fx:.1f} x {lens.fy:.1f} pixels, centre {lens.cx:.1f}, {lens.cy:.1f}")
    print(f"the board's corners fit within {lens.rms:.2f} pixels (rms); written to {chosen.out}")
    return 0


def _fitted(options: argparse.Namespace) -> "Lens":
    import cv2
    import numpy as np

    from cmr.camera.lens_fit import LensFit
    from cmr.camera.sources import open_source

    source = open_source(options.source, options.size, options.rate, 0.0, hurry=True)
    fit, wanted = LensFit(), 0
    try:
        with Progress(None if source.ends else options.pictures, "pictures") as progress:
            while source.ends or len(fit.views) < options.pictures:
                taken = source.read()
                if taken is None:
                    break
                if not source.ends and taken.utime < wanted:
                    continue
                if fit.see(np.asarray(cv2.cvtColor(taken.picture, cv2.COLOR_BGR2GRAY), np.uint8)):
                    wanted = taken.utime + int(options.every * 1e6)
                    progress.show(f"{len(fit.views)} pictures with the board", len(fit.views))
    finally:
        source.close()
        print(f"{len(fit.views)} pictures with the board")
    return fit.lens()


def _board(arguments: list[str]) -> int:
    """Write the board for the lens as a PDF."""
    options = parser("cmr-camera board", "Write the board for the lens as a PDF.", "cmr-camera board --out board.pdf")
    options.add_argument("--out", type=Path, default=Path("board.pdf"), metavar="FILE", help="to write")
    options.add_argument("--paper", choices=PAPERS, default="a4", help="size of the paper")
    chosen = options.parse_args(arguments)
    from cmr.camera.board import save_board

    try:
        save_board(chosen.out, chosen.paper)
    except OSError as error:
        raise CommandError(f"{chosen.out} cannot be written: {error.strerror}") from error
    print(f"{chosen.out}: print it at 100 %, and measure a square: 36 mm")
    return 0


def _tags(arguments: list[str]) -> int:
    """Write tags as a PDF."""
    options = parser(
        "cmr-camera tags", "Write tags as a PDF, one a page.", "cmr-camera tags 0-3,100-103 --size 0.16 --out tags.pdf"
    )
    options.add_argument("numbers", type=_numbers, metavar="N,N-N,...", help="of the tags, 0 to 586")
    options.add_argument("--size", type=parse_seconds, default=0.16, metavar="M", help="edge of the black square")
    options.add_argument("--out", type=Path, default=Path("tags.pdf"), metavar="FILE", help="to write")
    options.add_argument("--paper", choices=PAPERS, default="a4", help="size of the paper")
    chosen = options.parse_args(arguments)
    from cmr.camera.board import BoardError, save_tags

    try:
        save_tags(chosen.out, chosen.numbers, chosen.size, chosen.paper)
    except (BoardError, OSError) as error:
        raise CommandError(str(error)) from error
    print(f"{chosen.out}: print it at 100 %, and measure a black square: {1e3 * chosen.size:.0f} mm")
    return 0


def _numbers(text: str) -> list[int]:
    """Parse numbers of tags for argparse: 0-3,7."""
    numbers: list[int] = []
    for part in text.split(","):
        first, _, last = part.partition("-")
        if not (first.isdecimal() and (last or first).isdecimal()) or int(last or first) > 586:
            raise argparse.ArgumentTypeError(f"{text!r} are no numbers of tags, such as 0-3,7; the last one is 586")
        numbers += range(int(first), int(last or first) + 1)
    return numbers


def _size(text: str) -> tuple[int, int]:
    wide, _, high = text.partition("x")
    if not (wide.isdecimal() and high.isdecimal() and int(wide) and int(high)):
        raise argparse.ArgumentTypeError(f"{text!r} is no size of a picture, such as 1280x720")
    return int(wide), int(high)


def _rate(text: str) -> float:
    return parse_number(text, f"{text!r} is not a rate of 0 to 1000 Hz", least=0.0, most=1000.0)
