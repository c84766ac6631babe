"""Modules that are imported when they are first used: compiled functions import Numba, which takes half a second."""

from importlib import import_module
from typing import Any


class LazyModule:
    """What a module has, by the module's full name. An import where it is used would cost its time at every step."""

    def __init__(self, module: str) -> None:
        self._module = module

    def __getattr__(self, name: str) -> Any:
        """Return what the module has under this name; the next time it is found without coming here.

        A compiled function that is still to be loaded is found here again: then it is another, quicker one.
        """
        value = getattr(import_module(self._module), name)
        if not getattr(value, "unloaded", False):
            setattr(self, name, value)
        return value
