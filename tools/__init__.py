"""Log tools, which are run as cmr-* commands."""
