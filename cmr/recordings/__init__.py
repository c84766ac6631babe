"""Recordings of a robot as arrays: from an event log, or collected live from the bus."""

from cmr.recordings.batch import read_robots
from cmr.recordings.recording import Recorder, Recording, RecordingError, read_messages

__all__ = ["Recorder", "Recording", "RecordingError", "read_messages", "read_robots"]
