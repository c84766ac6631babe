"""Pseudo-terminals that look like serial ports: for emulated devices, and for proxies of real ones."""
