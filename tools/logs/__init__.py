"""cmr-log: what is in event logs, parts of them, and the same as tables and as MCAP files for Foxglove."""
