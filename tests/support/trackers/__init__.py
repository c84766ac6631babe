"""Emulated trackers that speak the published wire formats; they share no code with cmr.tracker."""
