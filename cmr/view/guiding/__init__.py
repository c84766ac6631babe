"""The page that guides through bring-up: announcements, questions, and a button that ends a motion."""

from cmr.view.guiding.sessions import GuideSessions

__all__ = ["GuideSessions"]
