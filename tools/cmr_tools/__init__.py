"""Log tools, run as cmr-* commands."""
