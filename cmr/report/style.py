"""The look of reports: colours for light and dark pages, and the style sheet.

Figures name their colours, as in `stroke="var(--real)"`, so that one drawing works for both. Paper is always light.
"""

from pathlib import Path

from cmr.report.colours import REAL_COLOUR, TWIN_COLOUR

TONES = ("plain", "good", "doubtful", "bad")  # of the header, depending on the result
DENSITY_STEPS = (1, 4, 16, 64)  # lowest numbers of robots of each density colour

# Contrast with `paper`, after WCAG 2.1: 4.5 for text, 3 for what is drawn. `grid` and `rule` carry no meaning.
# `real` is yellow, which needs its outline on white.
LIGHT = {
    "paper": "#ffffff",
    "panel": "#f4f5f8",
    "ink": "#1c1e22",
    "soft": "#4a4e57",
    "rule": "#c9ccd4",
    "grid": "#e4e6eb",
    "border": "#777777",
    "link": TWIN_COLOUR,
    "real": REAL_COLOUR,
    "real-outline": "#7a5a00",
    "simulated": TWIN_COLOUR,
    "before": "#668dee",
    "found": "#c2378f",
    "sample": "#8f949e",
    "doubt": "#6b4200",
    "doubt-panel": "#ffe6b3",
    "plain": TWIN_COLOUR,
    "good": "#2b7a4b",
    "doubtful": "#a85a00",
    "bad": "#b3261e",
    "density-1": "#668dee",
    "density-2": "#3a63dc",
    "density-3": "#163a9e",
    "density-4": "#060f33",
}
DARK = {
    "paper": "#15171b",
    "panel": "#22252b",
    "ink": "#e8eaee",
    "soft": "#aab0bb",
    "rule": "#454a54",
    "grid": "#2b2f36",
    "border": "#8a8f9a",
    "link": "#8fb0ff",
    "real": REAL_COLOUR,
    "real-outline": "#a07c1c",
    "simulated": "#8fb0ff",
    "before": "#5c82e6",
    "found": "#e06cbf",
    "sample": "#6c717c",
    "doubt": "#ffd591",
    "doubt-panel": "#4a3200",
    "plain": "#8fb0ff",
    "good": "#6fc793",
    "doubtful": "#f0a24a",
    "bad": "#ff8a80",
    "density-1": "#5473c4",
    "density-2": "#7fa0f8",
    "density-3": "#bccdff",
    "density-4": "#ffffff",
}


def colour(name: str) -> str:
    """Return a colour of the palettes by its name, for use in a figure or style."""
    return f"var(--{name})"


PAPER, INK, GRID, BORDER = (colour(name) for name in ("paper", "ink", "grid", "border"))
REAL, REAL_OUTLINE = colour("real"), colour("real-outline")
# "Before" curves are lighter, and dashed or hollow, so they do not depend on colour vision.
AFTER, BEFORE, FOUND, SAMPLE = (colour(name) for name in ("simulated", "before", "found", "sample"))
DENSITY = tuple(colour(f"density-{step}") for step in range(1, len(DENSITY_STEPS) + 1))


def style_sheet() -> str:
    """Return the style sheet for screen, phone and paper."""
    tones = "\n".join(
        f".{tone} {{ border-color: {colour(tone)}; }} .{tone} .badge {{ background: {colour(tone)}; }}"
        for tone in TONES
    )
    dark = f"@media screen and (prefers-color-scheme: dark) {{\n{_palette(DARK)}}}\n"
    return f"{_palette(LIGHT)}{dark}{Path(__file__).with_suffix('.css').read_text(encoding='utf-8')}{tones}\n"


def _palette(colours: dict[str, str]) -> str:
    named = " ".join(f"--{name}: {value};" for name, value in colours.items())
    return f":root {{ {named} }}\n"
