"""cmr-replay: the messages of an event log once more, on the bus or in another log, as they are or changed."""
