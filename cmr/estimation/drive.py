"""The part of a recording that is estimated from: all of the driving, with some of the rest before and after it.

A log may begin minutes before the robot moves and go on for minutes after it: how many would otherwise change the
numbers, and `cmr-calibrate`, which ends when the robot has stopped, would find others than `cmr-diagnose` does.
"""

import numpy as np

from cmr.recordings.faults.wheel_checks import motion_of
from cmr.recordings.recording import Recording
from cmr.recordings.signal import SECONDS, Times

# s of rest that are used. Those before tell the gyro's bias as well as its drift lets. A calibration ends after one
# second of rest.
REST_BEFORE, REST_AFTER = 10.0, 1.0
# Duties that are driving whatever the wheels say, of which an encoder may be broken. With smaller ones a controller may
# hold a robot that rests, for any time; they count within so many s of the motion: motors that do not turn tell of
# friction.
DRIVING, HELD_AT_REST = 0.05, 3.0


def drive_of(recording: Recording) -> Recording:
    """Return the drive within a recording: without longer rests before its first motion and after its last.

    A recording in which nothing moves and no motor is driven is returned as it is; `drive_of` a drive is the drive.
    """
    times = moments_of(recording)
    if not len(times):
        return recording
    before, after = round(REST_BEFORE / SECONDS), round(REST_AFTER / SECONDS)
    return recording.between(int(times[0]) - before, int(times[-1]) + after)


def moments_of(recording: Recording) -> Times:
    """Return the first and the last moment [us] of what the motors do, shape (2,); empty where they do nothing."""
    duty = recording.duty
    size = np.maximum(np.abs(duty["left"]), np.abs(duty["right"]))
    motion = np.array(motion_of(recording) or (), np.int64)
    driven = size > 0.0
    if len(motion):
        longest = round(HELD_AT_REST / SECONDS)
        near = (duty.utime >= motion[0] - longest) & (duty.utime <= motion[1] + longest)
        driven = (driven & near) | (size > DRIVING)
    times = np.concatenate([motion, duty.utime[driven]])
    return np.array([times.min(), times.max()], np.int64) if len(times) else times
