"""The measurements of scripts/bench: each module yields some rows of its table."""
