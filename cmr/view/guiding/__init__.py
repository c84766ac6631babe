"""The bring-up page: announcements, questions, and a button that stops a motion."""

from cmr.view.guiding.sessions import GuideSessions

__all__ = ["GuideSessions"]
