"""Access control of the page: who connects, what is sent, and how fast tokens are guessed."""
