"""Log tools, installed as `cmr.tools` and run as cmr-* commands."""
