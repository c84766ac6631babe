"""How far a piece of work is, on the terminal or in a notebook: the one place that knows how that looks."""

import sys
from types import TracebackType
from typing import TYPE_CHECKING

from cmr.news import is_quiet

if TYPE_CHECKING:
    from rich.progress import Progress as RichProgress


class Progress:
    """A bar on stderr that is gone when the work is done; a context manager.

    `total` is how many `unit` there are; None: nobody knows, and only the text is shown. Nothing is shown where stderr
    is neither a terminal nor a notebook's, or after --quiet.
    """

    def __init__(self, total: float | None = None, unit: str = "") -> None:
        self._total, self._unit = total, unit
        self.visible = not is_quiet() and (sys.stderr.isatty() or "ipykernel" in sys.modules)
        self._rich: RichProgress | None = None

    def __enter__(self) -> "Progress":
        if self.visible:
            self._rich = _bar(self._total is not None)
            self._rich.add_task("", total=self._total, unit=self._unit)
            self._rich.start()
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        if self._rich is not None:
            self._rich.stop()
            self._rich = None

    def show(self, text: str, done: float | None = None) -> None:
        """Show what is being done and, if it is known, how much has been."""
        if self._rich is not None:
            self._rich.update(self._rich.task_ids[0], description=text, completed=done)

    def say(self, text: str) -> None:
        """Write a line on stderr that stays, above the bar where there is one."""
        if self._rich is not None:
            self._rich.console.print(text, highlight=False, markup=False, soft_wrap=True)
        elif not is_quiet():
            print(text, file=sys.stderr, flush=True)


def _bar(counted: bool) -> "RichProgress":
    from rich.console import Console  # takes as long as all the rest of a start
    from rich.progress import BarColumn, MofNCompleteColumn, SpinnerColumn, TextColumn, TimeRemainingColumn
    from rich.progress import Progress as RichProgress
    from rich.table import Column

    text = TextColumn("{task.description}", markup=False, table_column=Column(no_wrap=True, ratio=1))
    counting = [BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[unit]}"), TimeRemainingColumn()]
    columns = [SpinnerColumn(), *(counting if counted else []), text]
    return RichProgress(*columns, console=Console(stderr=True), transient=True, expand=True)
