"""cmr-plot: draw fields of the messages of event logs.

Usage: cmr-plot RUN.lcm POSE_0.x:POSE_0.y MOTOR_FEEDBACK_0.psi_left --out figure.png
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from cmr.bus.fields import FieldName, unit_of
from cmr.cli.command_line import parser
from cmr.cli.errors import CommandError
from cmr_tools.events import damage_sentence, open_log, progress_of, reading
from cmr_tools.plot.fields import Gathered, against, near_names, parse_field
from cmr_tools.plot.figure import Curve, Panel, draw, figure_of
from cmr_tools.writing import complete_or_none

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FORMATS = (".png", ".svg", ".pdf")
TIME = "time since the log began [s]"
LENGTH = "m"


class Asked(NamedTuple):
    """What to draw: a field over time, or against another one, which is then horizontal."""

    vertical: FieldName
    horizontal: FieldName | None = None

    @property
    def names(self) -> tuple[FieldName, ...]:
        """The fields to read for it."""
        return (self.vertical,) if self.horizontal is None else (self.horizontal, self.vertical)


def main(arguments: list[str]) -> int:
    """Draw fields of logs.

    Raises CommandError if a log, a field or a file cannot be used.
    """
    options = _parse(arguments)
    asked = [_asked(text) for text in options.fields]
    names = {name for one in asked for name in one.names}
    gathered = [_gather(path, names) for path in options.logs]
    _check(options.logs, gathered, names)
    panels = _panels(asked, options.logs, gathered)
    title = ", ".join(_names(options.logs))
    if options.out is None:
        _show(panels, title, len(options.logs))
    else:
        _save(figure_of(panels, title, len(options.logs)), options.out)
        print(f"{options.out} shows {', '.join(options.fields)} of {title}.")
    return 0


def command_parser() -> argparse.ArgumentParser:
    """Return the command line of cmr-plot."""
    result = parser(
        "cmr-plot",
        "Draw fields of the messages of event logs: over time, or one against the other. Fields of the same unit share "
        "a panel; several logs lie over each other. Time is when a message says that it was measured, in seconds "
        "since its log began.",
        "cmr-plot run.lcm POSE_0.x MOTOR_FEEDBACK_0.psi_left\n"
        "  cmr-plot before.lcm after.lcm POSE_0.x:POSE_0.y --out paths.png\n"
        "  cmr-plot run.lcm 'WORLD_STATE.x[robot 10]:WORLD_STATE.y[robot 10]' --out path.svg",
        bus="accepted as by every command; to draw needs no bus",
    )
    result.add_argument(
        "what",
        nargs="+",
        metavar="RUN.lcm FIELD",
        help="event logs, then fields: CHANNEL.FIELD, of an array CHANNEL.FIELD[NUMBER], of WORLD_STATE "
        "one robot's, 'WORLD_STATE.x[robot 10]' or [twin 0], and with a colon between them the first, horizontal, "
        "against the second",
    )
    result.add_argument(
        "--log", type=Path, nargs="+", action="extend", default=[], metavar="RUN.lcm", help="the same as before fields"
    )
    result.add_argument("--out", type=Path, metavar="FILE", help="PNG, SVG or PDF to write; else a window opens")
    return result


def _parse(arguments: list[str]) -> argparse.Namespace:
    result = command_parser()
    options = result.parse_args(arguments)
    options.logs = [*(Path(text) for text in options.what if _is_log(text)), *options.log]
    options.fields = [text for text in options.what if not _is_log(text)]
    if not (options.logs and options.fields):
        result.error("at least one log (a file, RUN.lcm) and one field (POSE_0.x) are needed")
    if options.out is not None and options.out.suffix.lower() not in FORMATS:
        result.error(f"--out must end in {', '.join(FORMATS)}, not {options.out.name!r}")
    return options


def _is_log(text: str) -> bool:
    return text.endswith(".lcm") or "/" in text or Path(text).exists()


def _asked(text: str) -> Asked:
    first, colon, second = text.partition(":")
    return Asked(parse_field(second), parse_field(first)) if colon else Asked(parse_field(first))


def _gather(path: Path, names: set[FieldName]) -> Gathered:
    log = open_log(path)
    with progress_of([log]) as progress:
        gathered = Gathered(names, reading(log, progress))
    if damage_sentence(log):
        print(f"cmr-plot: {damage_sentence(log)}", file=sys.stderr)
    if gathered.rejected:
        print(f"cmr-plot: {path}: {gathered.rejected} messages could not be decoded.", file=sys.stderr)
    return gathered


def _check(paths: Sequence[Path], gathered: Sequence[Gathered], names: set[FieldName]) -> None:
    """Raise CommandError for a field that no log has; print on stderr which logs lack one that others have."""
    for name in sorted(names):
        lacking = [path for path, one in zip(paths, gathered, strict=True) if not len(one.values(name).values)]
        if len(lacking) == len(paths):
            channels = set().union(*(one.channels for one in gathered))
            near = near_names(str(name), channels)
            instead = f"Near names: {', '.join(near)}" if near else f"It has {', '.join(sorted(channels)) or 'nothing'}"
            raise CommandError(f"{', '.join(map(str, paths))} has no {name}. {instead}.")
        for path in lacking:
            print(f"cmr-plot: {path} has no {name}.", file=sys.stderr)


def _panels(asked: Sequence[Asked], paths: Sequence[Path], gathered: Sequence[Gathered]) -> list[Panel]:
    """Return the panels, in the order of the command line; curves with the same axes share one."""
    groups: dict[tuple[str, ...], list[Asked]] = {}
    for one in asked:
        over_time = (unit_of(one.vertical) or one.vertical.field,)
        key = over_time if one.horizontal is None else (one.horizontal.field, one.vertical.field)
        groups.setdefault(key, []).append(one)
    return [_panel(group, paths, gathered) for group in groups.values()]


def _names(paths: Sequence[Path]) -> list[str]:
    """Return labels for the logs: their names, or their paths if two have the same name."""
    names = [path.name for path in paths]
    return names if len(set(names)) == len(names) else [str(path) for path in paths]


def _panel(group: Sequence[Asked], paths: Sequence[Path], gathered: Sequence[Gathered]) -> Panel:
    horizontal = [one.horizontal for one in group if one.horizontal is not None]
    curves = [
        _curve(one, (log, field), name if len(paths) > 1 else "", values)
        for field, one in enumerate(group)
        for log, (name, values) in enumerate(zip(_names(paths), gathered, strict=True))
    ]
    return Panel(
        x_label=_label(horizontal) if horizontal else TIME,
        y_label=_label([one.vertical for one in group]),
        curves=curves,
        over_time=not horizontal,
        same_scale=bool(horizontal) and unit_of(horizontal[0]) == unit_of(group[0].vertical) == LENGTH,
    )


def _curve(one: Asked, numbers: tuple[int, int], log: str, gathered: Gathered) -> Curve:
    """Return the curve of one log, which is named if there are several; `numbers` of log and field."""
    vertical = gathered.values(one.vertical)
    label = str(one.vertical) if one.horizontal is None else f"{one.vertical} against {one.horizontal}"
    if log:
        label = f"{label}, {log}"
    if one.horizontal is None:
        return Curve(label, vertical.seconds, vertical.values, *numbers)
    return Curve(label, *against(gathered.values(one.horizontal), vertical), *numbers)


def _label(names: Sequence[FieldName]) -> str:
    """Return the label of an axis: the field, or the common part of several; and the unit."""
    unit = unit_of(names[0])
    text = str(names[0]) if len(names) == 1 else ", ".join(dict.fromkeys(name.field for name in names))
    return f"{text} [{unit}]" if unit else text


def _save(figure: "Figure", path: Path) -> None:
    try:
        with complete_or_none(path) as temporary:
            figure.savefig(temporary, format=path.suffix[1:].lower())
    except OSError as error:
        raise CommandError(f"{error.filename or path}: {error.strerror or error}") from error


def _show(panels: Sequence[Panel], title: str, logs: int) -> None:
    """Show a window until it is closed."""
    import matplotlib
    from matplotlib import pyplot  # slow to import; it chooses a window system

    figure = pyplot.figure(figsize=(10.0, 7.5), layout="constrained")
    if matplotlib.get_backend().lower() == "agg":
        raise CommandError("No window can be opened here. Name a file with --out, such as --out figure.png.")
    draw(figure, panels, title, logs)
    pyplot.show()
