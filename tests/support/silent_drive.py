"""A drive whose sensors read zeros: its prediction errors are what the sensors should read, with the other sign."""

import numpy as np

from cmr.model.commands import Commands
from cmr.model.observer.observer import Observations


def silent_drive(commands: Commands, dt: float, steps: int, *, pose_every: int = 1) -> Observations:
    """Return a drive from rest with these commands, read at the borders of its steps of `dt` [s].

    A pose comes at every `pose_every`-th of them.
    """
    borders = np.asarray(np.arange(1, steps) * dt, np.float64)
    at_poses = np.ascontiguousarray(borders[::pose_every])
    return Observations(
        dt=dt,
        steps=steps,
        commands=commands,
        start=(0.0, 0.0, 0.0, 0.0, 0.0),
        wheel_time=borders,
        wheel=np.zeros((len(borders), 2)),
        wheel_use=np.ones((len(borders), 2), np.uint8),
        gyro_time=borders,
        gyro=np.zeros(len(borders)),
        pose_time=at_poses,
        pose=np.zeros((len(at_poses), 3)),
        pose_use=np.ones(len(at_poses), np.uint8),
    )
