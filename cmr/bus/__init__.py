"""The LCM bus: which channels exist, how messages are read and written, and how a process lives on it."""
