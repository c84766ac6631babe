"""The parse tree of a formula."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property


@dataclass(frozen=True)
class Part:
    """One part of a formula: `kind` is "number", "name", an operator, "negative" or a function; `at` is its
    position.
    """

    kind: str
    at: int
    name: str = ""
    number: float = 0.0
    parts: tuple["Part", ...] = ()

    @cached_property
    def names(self) -> frozenset[str]:
        """Its variables and constants, including x and y for `disc`."""
        own = {self.name} if self.kind == "name" else {"x", "y"} if self.kind == "disc" else set()
        return frozenset(own).union(*(part.names for part in self.parts))

    def walk(self) -> Iterator["Part"]:
        """Yield this part and all parts within it."""
        yield self
        for part in self.parts:
            yield from part.walk()
