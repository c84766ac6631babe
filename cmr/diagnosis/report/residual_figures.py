"""Figures of residuals: large ones of single pairs, and small multiples of all."""

from collections.abc import Iterable, Sequence
from itertools import groupby

import numpy as np

from cmr.diagnosis.report.binned import TAIL, Bins, thinned
from cmr.diagnosis.report.pairs import Pair
from cmr.diagnosis.report.terms import regressor, signal_words
from cmr.recordings.signal import Floats
from cmr.report.keys import DASHES, after_key, before_key, keys, sample_key
from cmr.report.markup import Html, joined, tag
from cmr.report.numbers import number, unit_text
from cmr.report.section import folded
from cmr.report.style import AFTER, BEFORE, SAMPLE
from cmr.report.svg import Curve, Frame, Range, dots, error_bars, line, plot, squares, zero_line

MANY, FEW = 1500, 220  # samples of a scatter, in a large and in a small plot
LARGE = {"width": 390.0, "height": 275.0}
SMALL = {"width": 170.0, "height": 122.0, "text": 10.0, "room_left": 3.7, "room_top": 0.5}
SEEN = 0.9  # share of samples within a large plot's range; small plots have less
SEEN_SMALL = 0.6


def tell_tale_figure(pair: Pair, caption: str, cause: str = "the effect") -> Html:
    """Plot a pair with and without its cause, side by side, with common axes."""
    limit = _limit([pair.means_before, pair.means_after], [pair.before, pair.after], SEEN)
    plots = [_large(pair, pair.before, pair.means_before, f"without {cause}", limit)]
    plots.append(_large(pair, pair.after, pair.means_after, f"with {cause}", limit))
    return _figure(tag("div", *plots, class_="plots"), caption)


def remaining_figure(pairs: Sequence[Pair], caption: str) -> Html:
    """Plot the extended model's residual of a signal over each of these regressors."""
    limit = _limit([pair.means_after for pair in pairs], [pairs[0].after], SEEN)
    plots = [
        _large(pair, pair.after, pair.means_after, f"over {regressor(pair.regressor).words}", limit) for pair in pairs
    ]
    return _figure(tag("div", *plots, class_="plots"), caption)


def all_residuals(pairs: Iterable[Pair], *, changed: bool) -> Html:
    """Plot small multiples of all pairs, about seventy, in a collapsed figure per signal."""
    return joined(
        *(_multiples(signal, list(group), changed) for signal, group in groupby(pairs, key=lambda pair: pair.signal))
    )


def _figure(plots: Html, caption: str) -> Html:
    means = after_key("mean in a bin, \u00b1 1 standard error", marked=True)
    return tag("figure", keys(means, sample_key("samples")), plots, tag("figcaption", caption))


def _large(pair: Pair, residual: Floats, bins: Bins, title: str, limit: Range) -> Html:
    frame = Frame(x=_extent(pair.over), y=limit, **LARGE)
    shown = thinned(len(residual), MANY)
    return plot(
        frame,
        dots(frame, pair.over[shown], residual[shown], SAMPLE, 2.2),
        zero_line(frame),
        _means_after(frame, bins, 5.5, f"mean [{unit_text(pair.unit)}]"),
        x_label=regressor(pair.regressor).label,
        y_label=f"{signal_words(pair.signal)}, real \u2212 model [{unit_text(pair.unit)}]",
        title=title,
        alt=_alt(pair, bins, title),
    )


def _multiples(signal: str, pairs: list[Pair], changed: bool) -> Html:
    """Return one signal's residual over all regressors, on the same vertical axis."""
    bins = [b for pair in pairs for b in ((pair.means_before, pair.means_after) if changed else (pair.means_before,))]
    limit = _limit(bins, [pairs[0].before], SEEN_SMALL)
    plots = [_small(pair, limit, changed) for pair in pairs]
    words = f"{signal_words(signal)}, real minus model [{unit_text(pairs[0].unit)}]"
    entries = [before_key("mean before", marked=True)] if changed else []
    entries.append(after_key("mean after" if changed else "mean", marked=True))
    entries.append(sample_key("samples before" if changed else "samples"))
    caption = tag("figcaption", f"Residuals of the {words}, over all regressors.")
    figure = tag("figure", keys(*entries), tag("div", *plots, class_="small"), caption)
    return folded(f"{words[0].upper()}{words[1:]}: {len(plots)} plots", figure)


def _small(pair: Pair, limit: Range, changed: bool) -> Html:
    frame = Frame(x=_extent(pair.over), y=limit, **SMALL)
    shown = thinned(len(pair.before), FEW)
    before, after = pair.means_before, pair.means_after
    after_words = "mean after" if changed else "mean"
    return plot(
        frame,
        dots(frame, pair.over[shown], pair.before[shown], SAMPLE, 1.8),
        zero_line(frame),
        _means_before(frame, before, f"mean before [{unit_text(pair.unit)}]") if changed else Html(""),
        _means_after(frame, after, 3.2, f"{after_words} [{unit_text(pair.unit)}]"),
        x_label=regressor(pair.regressor).label,
        alt=_alt(pair, before, "before") + (f" {_alt(pair, after, 'after')}" if changed else ""),
    )


def _means_before(frame: Frame, bins: Bins, name: str) -> Html:
    curve = Curve(name, error=bins.error)
    return joined(
        line(frame, bins.centre, bins.mean, BEFORE, 1.1, dashes=DASHES, curve=curve),
        error_bars(frame, bins.centre, bins.mean, bins.error, BEFORE),
        squares(frame, bins.centre, bins.mean, BEFORE, 4.6),
    )


def _means_after(frame: Frame, bins: Bins, size: float, name: str) -> Html:
    return joined(
        line(frame, bins.centre, bins.mean, AFTER, 1.1, curve=Curve(name, error=bins.error)),
        error_bars(frame, bins.centre, bins.mean, bins.error, AFTER),
        dots(frame, bins.centre, bins.mean, AFTER, size),
    )


def _extent(values: Floats) -> Range:
    """Return the range of a regressor without its extreme tails, with some room."""
    finite = values[np.isfinite(values)]
    if not len(finite):
        return 0.0, 1.0
    low, high = (float(end) for end in np.quantile(finite, (TAIL, 1.0 - TAIL)))
    room = 0.05 * (high - low) or max(0.05 * abs(low), 0.05)
    return low - room, high + room


def _limit(bins: Sequence[Bins], residuals: Sequence[Floats], seen: float) -> Range:
    """Return a range that contains zero, all means with their errors, and this share of each residual's samples."""
    finite = [residual[np.isfinite(residual)] for residual in residuals]
    ends = [np.quantile(f, (0.5 - 0.5 * seen, 0.5 + 0.5 * seen)) for f in finite if len(f)]
    known = [np.isfinite(b.mean) for b in bins]
    tops = [float(np.max((b.mean + b.error)[k], initial=0.0)) for b, k in zip(bins, known, strict=True)]
    lows = [float(np.min((b.mean - b.error)[k], initial=0.0)) for b, k in zip(bins, known, strict=True)]
    low = min([0.0, *lows, *(float(end[0]) for end in ends)])
    high = max([0.0, *tops, *(float(end[1]) for end in ends)])
    room = 0.08 * (high - low) or 1.0
    return low - room, high + room


def _alt(pair: Pair, bins: Bins, title: str) -> str:
    """Describe the range of the means in words."""
    over = f"{signal_words(pair.signal)}, real minus model, over {regressor(pair.regressor).words}"
    if not np.any(np.isfinite(bins.mean)):
        return f"{over}, {title}: too few samples for means."
    low, high = (number(float(end), 2) for end in (np.nanmin(bins.mean), np.nanmax(bins.mean)))
    return f"{over}, {title}: means between {low} and {high} {unit_text(pair.unit)}."
