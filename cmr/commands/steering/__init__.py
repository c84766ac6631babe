"""What cmr-pilot and cmr-investigate share: a process that steers a robot, and its options."""
