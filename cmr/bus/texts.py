"""Sanitise the texts in incoming messages, so that they are safe to show."""

from cmr.bus.message import Message
from cmr.bus.streams import PARAMETERS, STREAMS
from cmr.plain_text import plain

LONGEST_TEXT = 2_000  # characters
LONGEST_DIGESTS = 100_000  # of a thousand parameter files that a simulator uses
# The texts of each message type, and their greatest lengths. The text of a parameter file is kept as it is, or refused.
TEXTS = {
    stream.message_type: {
        name: LONGEST_DIGESTS if name == "parameters_sha256" else LONGEST_TEXT
        for name, kind in zip(stream.message_type.__slots__, stream.message_type.__typenames__, strict=True)
        if kind == "string"
    }
    for stream in STREAMS
    if stream is not PARAMETERS
}
TEXTS = {message_type: texts for message_type, texts in TEXTS.items() if texts}


def make_plain(message: Message) -> None:
    """Remove terminal control characters from a message's texts, and truncate texts that are too long."""
    for name, longest in TEXTS.get(type(message), {}).items():
        setattr(message, name, plain(getattr(message, name), longest))
