"""What was recorded of a robot, as arrays: from an event log, or gathered live from the bus."""

from cmr.recordings.recording import Recorder, Recording, RecordingError

__all__ = ["Recorder", "Recording", "RecordingError"]
