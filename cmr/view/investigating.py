"""An investigation as an HTML overlay: remaining explanations as bars, the current movement, and its reason."""

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from cmr.msg import investigation_status_t as status_t
from cmr.report.likelihood import length, odds
from cmr.report.markup import Html, tag
from cmr.view.data.state import Arrival, ViewState
from cmr.view.inputs import plain

MOST_BARS = 8  # explanations shown, likeliest first
IN_WORDS = {
    status_t.OPENING: "Opening: it rests, turns both ways, and drives forth and back.",
    status_t.PLANNING: "It rests while the next movement is planned.",
    status_t.DONE: "The investigation is over.",
    status_t.FAILED: "It ended before its time.",
}


class Bar(NamedTuple):
    """An explanation: its name, current probability, and that at the previous decision [0 to 1]."""

    name: str
    now: float
    before: float


def investigated(state: ViewState, chosen: int) -> Sequence[Arrival[status_t]]:
    """Return the reports of the chosen robot's investigation, or of any; empty without one."""
    robot_id = chosen if chosen in state.investigations else next(iter(state.investigations), None)
    return () if robot_id is None else state.investigations[robot_id]


def card(history: Sequence[Arrival[status_t]]) -> str:
    """Return the overlay; empty without an investigation."""
    if not history:
        return ""
    message = history[-1].message
    bars = bars_of(history)
    parts = [
        tag("h2", f"Investigation of robot {message.robot_id}: {message.driven:.0f} s driven"),
        *_named(message),
        *_counts(message),
        *([tag("ul", *map(_bar, bars))] if bars else []),
        *(tag("p", sentence) for sentence in _doing(message)),
    ]
    label = f"investigation of robot {message.robot_id}"
    return plain(tag("section", *parts, class_="cmr-investigation", aria_label=label))


def bars_of(history: Sequence[Arrival[status_t]]) -> list[Bar]:
    """Return the likeliest explanations, and those that dropped out since the previous decision."""
    now = _probabilities(history[-1].message)
    texts = (heard.message.explanations for heard in reversed(history))
    before = next((_parsed(text) for text in texts if text != history[-1].message.explanations), {})
    names = list(now)[:MOST_BARS]
    gone = [name for name in list(before)[:MOST_BARS] if name not in now]
    names += gone[: MOST_BARS - len(names)]
    return [Bar(name, now.get(name, 0.0), before.get(name, 0.0)) for name in names]


def _bar(bar: Bar) -> Html:
    filled = f"--from:{100.0 * length(bar.before):.0f}%;--to:{100.0 * length(bar.now):.0f}%"
    track = tag("s", tag("b", style=filled), aria_hidden="true")
    return tag("li", tag("span", bar.name), track, tag("em", odds(bar.now)))


def _named(message: status_t) -> Iterator[Html]:
    names = _listed(message.named)
    if names:
        yield tag("p", tag("strong", f"Named: {', '.join(names)}"))


def _counts(message: status_t) -> Iterator[Html]:
    """Yield the number of explanations of each kind; nothing before the first decision."""
    left = len(_probabilities(message))
    if left:
        words = "1 explanation" if left == 1 else f"{left} explanations"
        yield tag("p", f"{words} left, {message.excluded} excluded, {message.not_shown} could not show yet")


def _doing(message: status_t) -> Iterator[str]:
    """Yield what the robot does, and why."""
    if message.state == status_t.DRIVING:
        yield f"Drives: {message.movement}"
        yield f"Why: to separate {message.first} from {message.second}"
    else:
        yield IN_WORDS.get(message.state, "")
    if message.message:
        yield message.message


def _probabilities(message: status_t) -> Mapping[str, float]:
    return _parsed(message.explanations)


def _parsed(text: str) -> Mapping[str, float]:
    """Parse the probabilities in a message, by name; invalid ones are omitted."""
    try:
        found = json.loads(text)
    except ValueError:
        return {}
    pairs = found.items() if isinstance(found, dict) else ()
    return {name: float(share) for name, share in pairs if isinstance(share, int | float) and 0.0 <= share <= 1.0}


def _listed(text: str) -> list[str]:
    try:
        found = json.loads(text)
    except ValueError:
        return []
    return [str(name) for name in found] if isinstance(found, list) else []
