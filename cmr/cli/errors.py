"""Errors that a user can put right."""


class ExpectedError(Exception):
    """Something cannot be done; the text is one line that says what is wrong and what to do."""


class CommandError(ExpectedError):
    """The command cannot do what was asked."""
