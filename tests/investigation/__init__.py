"""The robot that chooses its next movement."""
