"""cmr-plot: fields of messages over time, from event logs."""
