"""The effects that come with CMR, one module for each group."""
