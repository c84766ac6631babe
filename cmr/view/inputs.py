"""A word on viser's inputs: mypy takes their value for read-only, which it is not."""

from typing import Any


def write(handle: Any, value: object) -> None:
    """Put a value into an input of a page."""
    handle.value = value
