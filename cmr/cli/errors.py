"""Errors that a user can correct."""


class ExpectedError(Exception):
    """Something cannot be done; the text is one line that says what is wrong and what to do."""


class CommandError(ExpectedError):
    """The command cannot do what was requested."""
