"""Pseudo-terminals that look like serial ports: of emulated devices, and of what stands before real ones."""
