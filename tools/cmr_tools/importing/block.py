"""A block of a mapping file, read key by key; missing, unknown and wrong keys are reported with the allowed values."""

from collections.abc import Iterable, Iterator

from cmr.documents.document import DocumentError, Item, Place, is_finite, quoted


class MappingError(DocumentError):
    """The mapping cannot be used; the text names file, line and key, the error and the allowed values."""

    between = ": "


class Block:
    """The keys of one block of a document.

    Raises MappingError on construction if it is not a block of keys.
    """

    def __init__(self, item: Item) -> None:
        if not item.is_mapping:
            raise item.place.error(f"must be a block of keys, not {quoted(item.value)}")
        self._item = item
        self._items = dict(item.entries())
        self._asked: list[str] = []
        self.place = item.place

    def __iter__(self) -> Iterator[str]:
        return iter(self._items)

    def error(self, key: str, problem: str) -> DocumentError:
        """Return an error about a key."""
        return self.found(key).error(problem)

    def found(self, *keys: str) -> Place:
        """Return the place of a path of keys, as far as they exist."""
        return self._item.found(keys)

    def value(self, key: str) -> object:
        """Return the value of `key`; None if it is not in the file."""
        self._asked.append(key)
        return self._items[key].value if key in self._items else None

    def text(self, key: str) -> str:
        """Return a required text."""
        value = self.value(key)
        if not isinstance(value, str) or not value.strip():
            raise self.error(key, f"must be a text, not {quoted(value)}")
        return value.strip()

    def choice(self, key: str, allowed: Iterable[str], default: str | None = None) -> str:
        """Return one of the allowed words."""
        value = self.value(key)
        value = default if value is None else value
        if value not in list(allowed):
            raise self.error(key, f"is {quoted(value)}; allowed are {', '.join(allowed)}")
        return str(value)

    def number(self, key: str, default: float | None = None, *, positive: bool = False) -> float:
        """Return a finite number, required unless it has a default."""
        value = self.value(key)
        value = default if value is None else value
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not is_finite(value):
            raise self.error(key, f"must be a number, not {quoted(value)}")
        if positive and value <= 0:
            raise self.error(key, f"must be greater than 0, not {quoted(value)}")
        return float(value)

    def count(self, key: str, default: int) -> int:
        """Return a whole number, 0 or more."""
        value = self.value(key)
        value = default if value is None else value
        if type(value) is not int or value < 0:
            raise self.error(key, f"must be a whole number, 0 or more, not {quoted(value)}")
        return value

    def switch(self, key: str) -> bool:
        """Return true or false, false if it is not in the file."""
        value = self.value(key)
        if value is not None and not isinstance(value, bool):
            raise self.error(key, f"must be true or false, not {quoted(value)}")
        return bool(value)

    def texts(self, key: str) -> tuple[str, ...]:
        """Return a required list of distinct texts."""
        value = self.value(key)
        if not isinstance(value, list) or not value or not all(isinstance(one, str) and one.strip() for one in value):
            raise self.error(key, f"must be a list of names, not {quoted(value)}")
        texts = tuple(one.strip() for one in value)
        if len(set(texts)) < len(texts):
            twice = next(text for text in texts if texts.count(text) > 1)
            raise self.error(key, f"names {quoted(twice)} more than once")
        return texts

    def block(self, key: str) -> "Block":
        """Return the required block under `key`."""
        self._asked.append(key)
        if key not in self._items:
            raise self.error(key, "must be a block of keys, not None")
        return Block(self._items[key])

    def finish(self) -> None:
        """Raise MappingError if the block has a key that was not read."""
        for key in self:
            if key not in self._asked:
                raise self.error(key, f"unknown key; allowed are {', '.join(dict.fromkeys(self._asked))}")
