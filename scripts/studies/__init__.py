"""Studies over hundreds of logs: what they run, in which processes, and how they show what came of it."""
