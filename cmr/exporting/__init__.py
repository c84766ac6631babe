"""A calibrated robot in other simulators and robot descriptions: what `cmr-export` writes, and what it carries."""
