"""The effects shipped with CMR, one module per group."""
