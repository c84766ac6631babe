"""The joystick: a page of its own beside viser's, made for phones, with which robots are driven by hand."""

from cmr.view.driving.sessions import DriveSessions

__all__ = ["DriveSessions"]
