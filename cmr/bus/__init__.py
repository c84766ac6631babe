"""The LCM bus: its channels, how messages are encoded and checked, and the life of a process on it."""
