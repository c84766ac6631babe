"""The joystick: an additional page for phones, to drive robots by hand."""

from cmr.view.driving.sessions import DriveSessions

__all__ = ["DriveSessions"]
