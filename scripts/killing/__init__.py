"""The robot, the kills and the results of scripts/kill."""
