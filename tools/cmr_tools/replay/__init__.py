"""cmr-replay: send the messages of an event log again, to the bus or another log, unchanged or modified."""
