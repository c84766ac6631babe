"""cmr-log: inspect event logs, cut and merge them, and convert them to tables and to MCAP files for Foxglove."""
