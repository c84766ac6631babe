"""Compare the paths of a real robot and its twin, drive by drive, from the log of a run."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cmr.msg import pose_xyt_t, world_state_t
from cmr.recordings.commanding import COMMANDS, asks_to_move
from cmr.recordings.events import LogReader
from cmr.recordings.recording import Floats, Times
from cmr.report.paths import draw_paths
from cmr.world.view import WorldView
from cmr.world.world import REST_BEFORE_DRIVE

SETTLING = 100_000  # us after the first command, by which the twin, placed at its robot, has surely been published
SHORTEST_DRIVE = 2_000_000  # us
TITLES = ("before calibration", "after calibration")


@dataclass(frozen=True)
class Drive:
    """One drive of a real robot and of its twin: measured and simulated positions [m] at the same times, shape (n,)."""

    utime: Times
    real_x: Floats
    real_y: Floats
    twin_x: Floats
    twin_y: Floats

    @property
    def path_rmse(self) -> float:
        """Root mean square distance between the two [m]."""
        return float(np.sqrt(np.mean((self.real_x - self.twin_x) ** 2 + (self.real_y - self.twin_y) ** 2)))


def drives_of(log: Path, robot_id: int) -> list[Drive]:
    """Return the drives of a robot in an event log: intervals of commands between rests for which pose and twin are
    known.
    """
    driven: list[int] = []
    poses: list[tuple[int, float, float]] = []
    twins: list[tuple[int, float, float]] = []
    view = WorldView()
    for received in LogReader(log):
        message = received.message
        if isinstance(message, world_state_t):
            view.handle(message.utime, received.channel, message)
            twin = view.twin(robot_id)
            if twin is not None and twin.utime == message.utime:
                twins.append((message.utime, twin.state.x, twin.state.y))
        elif received.robot_id != robot_id:
            continue
        elif isinstance(message, pose_xyt_t):
            poses.append((message.utime, message.x, message.y))
        elif isinstance(message, COMMANDS) and asks_to_move(message):
            driven.append(message.utime)
    pauses = np.flatnonzero(np.diff(driven) > REST_BEFORE_DRIVE) + 1
    spans = [(int(part[0]), int(part[-1])) for part in np.split(np.array(driven, np.int64), pauses) if len(part)]
    drives = [_drive(poses, twins, *span) for span in spans if span[1] - span[0] >= SHORTEST_DRIVE]
    return [drive for drive in drives if drive is not None]


def _drive(
    poses: list[tuple[int, float, float]], twins: list[tuple[int, float, float]], first: int, last: int
) -> Drive | None:
    real = np.array([row for row in poses if first + SETTLING <= row[0] <= last])
    twin = np.array([row for row in twins if first + SETTLING // 2 <= row[0] <= last])
    if len(real) < 2 or len(twin) < 2:
        return None
    utime = real[:, 0]
    return Drive(
        utime.astype(np.int64),
        real[:, 1],
        real[:, 2],
        np.interp(utime, twin[:, 0], twin[:, 1]),
        np.interp(utime, twin[:, 0], twin[:, 2]),
    )


def draw_before_and_after(drives: tuple[Drive, Drive], path: Path) -> None:
    """Write a picture of two drives side by side, real path yellow and simulated path blue, to `path`."""
    from matplotlib.figure import Figure  # slow to import, and writes a cache

    figure = Figure(figsize=(11.0, 5.5), dpi=120, layout="constrained")
    for axes, drive, title in zip(figure.subplots(1, 2), drives, TITLES, strict=True):
        real, start = (drive.real_x, drive.real_y), (drive.real_x[:1], drive.real_y[:1])
        words = f"{title}\npath error {drive.path_rmse:.3f} m (root mean square)"
        draw_paths(axes, real, (drive.twin_x, drive.twin_y), start, words)
    figure.savefig(path)
