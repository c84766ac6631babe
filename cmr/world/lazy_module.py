"""Modules that are imported when they are first used: compiled functions import Numba, which takes half a second."""

from importlib import import_module
from typing import Any


class LazyModule:
    """A module, by its full name, imported at first use. An import statement in the calling function would cost time at
    every step.
    """

    def __init__(self, module: str) -> None:
        self._module = module

    def __getattr__(self, name: str) -> Any:
        """Return the module's attribute of this name and cache it.

        A compiled function that is not loaded yet is not cached: once loaded, a faster object replaces it.
        """
        value = getattr(import_module(self._module), name)
        if not getattr(value, "unloaded", False):
            setattr(self, name, value)
        return value
