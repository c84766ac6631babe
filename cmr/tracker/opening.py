"""Open the tracker that a profile names, with the package for its type."""

import time

from cmr.distribution import how_to_install
from cmr.tracker.profile import Tracker
from cmr.tracker.source import Clock, Source, SourceError


def open_source(tracker: Tracker, clock: Clock = time.monotonic_ns) -> Source:
    """Return the source of a profile's tracker. Raises SourceError."""
    try:
        return _open(tracker, clock)
    except ModuleNotFoundError as error:
        if error.name not in ("natnet", "qtm_rt", "motioncapture"):
            raise
        raise SourceError(
            f"A tracker of type {tracker.type} needs the package {error.name}. To install it: "
            f"{how_to_install('tracker')}"
        ) from error


def _open(tracker: Tracker, clock: Clock) -> Source:
    if tracker.type == "optitrack":
        from cmr.tracker.optitrack import OptiTrack

        return OptiTrack(tracker, clock)
    if tracker.type == "qualisys":
        from cmr.tracker.qualisys import Qualisys

        return Qualisys(tracker, clock)
    if tracker.type == "vrpn":
        from cmr.tracker.vrpn import Vrpn

        return Vrpn(tracker, clock)
    from cmr.tracker.motion_capture import MotionCapture

    return MotionCapture(tracker, clock)
