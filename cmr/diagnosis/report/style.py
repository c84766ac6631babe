"""How the report looks: its colours, and its style sheet for screen, phone and paper."""

from cmr.colours import REAL_COLOUR, TWIN_COLOUR

REAL, REAL_OUTLINE = REAL_COLOUR, "#7a5a00"  # outlined in brown, because yellow alone is faint on white
AFTER, BEFORE = TWIN_COLOUR, "#668dee"  # lighter, and dashed or hollow, so that nobody needs to see the colour
SCATTER = "#c9ccd4"
INK, GRID = "#1c1e22", "#e4e6eb"

VERDICT_COLOURS = {"effects_found": AFTER, "no_effect": "#2b7a4b", "unexplained": "#a85a00", "bad_data": "#b3261e"}

STYLE = (
    """
:root { color-scheme: light; }
* { box-sizing: border-box; }
html { -webkit-text-size-adjust: 100%; }
body { margin: 0 auto; max-width: 68rem; padding: 1.5rem 1rem 4rem; background: #fff; color: #1c1e22;
  font: 1rem/1.5 -apple-system, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif;
  overflow-wrap: break-word; counter-reset: figure table; }
h1 { font-size: 1.6rem; line-height: 1.3; margin: 0 0 .5rem; max-width: 48rem; font-weight: 650; }
h2 { font-size: 1.2rem; margin: 2.75rem 0 .75rem; padding-top: .6rem; border-top: 1px solid #c9ccd4; }
h3 { font-size: 1rem; margin: 1.75rem 0 .4rem; }
p, li { max-width: 48rem; }
p { margin: .5rem 0; }
code, pre { font: .875em/1.45 ui-monospace, SFMono-Regular, Menlo, Consolas, "DejaVu Sans Mono", monospace; }
pre { background: #f4f5f8; border-radius: 4px; padding: .7rem .9rem; margin: .5rem 0; overflow-x: auto; }
header { border-left: 6px solid #1c1e22; padding: .15rem 0 .15rem 1rem; }
header p { margin: 0; color: #4a4e57; }
.badge { color: #fff; border-radius: 3px; padding: .1rem .5rem; font-weight: 600; white-space: nowrap; }
.key { display: flex; flex-wrap: wrap; gap: .75rem 2.5rem; margin: 1.25rem 0 0; }
.key dt { color: #4a4e57; font-size: .875rem; }
.key dd { margin: 0; font-size: 1.35rem; font-variant-numeric: tabular-nums; }
table { border-collapse: collapse; width: 100%; margin: .75rem 0; font-size: .925rem; }
th, td { text-align: left; vertical-align: top; padding: .4rem .9rem .4rem 0; border-bottom: 1px solid #e4e6eb; }
thead th { border-bottom: 1.5px solid #1c1e22; vertical-align: bottom; font-weight: 600; }
tbody th { font-weight: 600; }
td.number { font-variant-numeric: tabular-nums; white-space: nowrap; }
td p { margin: 0 0 .25rem; white-space: nowrap; }
.quiet { color: #4a4e57; font-size: .9rem; }
.unreliable { color: #6b4200; background: #ffe6b3; border-radius: 3px; padding: .1rem .4rem; font-size: .875rem; }
figure { margin: 1rem 0 1.5rem; }
figcaption { font-size: .9rem; color: #33363d; max-width: 48rem; margin-top: .4rem; }
figcaption::before { counter-increment: figure; content: "Figure " counter(figure) ". "; font-weight: 600; }
svg { display: block; width: 100%; height: auto; font-family: inherit; fill: #1c1e22; }
svg svg { width: auto; height: auto; }
.plots { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(18rem, 100%), 1fr)); gap: .5rem 1rem; }
.plots > svg { max-width: 34rem; }
.paths > svg { max-width: 24rem; }
.small { display: grid; grid-template-columns: repeat(auto-fill, minmax(9.25rem, 1fr)); gap: .5rem .75rem; }
.keys { display: flex; flex-wrap: wrap; gap: .2rem 1.4rem; font-size: .875rem; margin: .4rem 0; }
.keys span { display: inline-flex; align-items: center; gap: .45rem; }
.keys svg { width: 2rem; height: .9rem; flex: none; }
summary { cursor: pointer; }
.bar { width: 9rem; min-width: 6rem; }
@media (max-width: 46rem) {
  body { padding: 1rem .9rem 3rem; }
  h1 { font-size: 1.3rem; }
  .stacks thead { display: none; }
  .stacks tr, .stacks td, .stacks th, .stacks tbody, .stacks { display: block; }
  .stacks tbody th { font-size: 1rem; }
  .stacks tbody th code { font-weight: 700; }
  .stacks tr { border-bottom: 1.5px solid #1c1e22; padding: .35rem 0; }
  .stacks td, .stacks tbody th { border: 0; padding: .15rem 0; white-space: normal; }
  .stacks td::before { content: attr(data-label) ": "; color: #4a4e57; font-size: .85rem; }
  .stacks td.blank { display: none; }
}
@page { size: A4; margin: 16mm 15mm; }
@media print {
  html { font-size: 9.5pt; }
  body { max-width: none; padding: 0; }
  h2 { margin-top: 7mm; }
  h2, h3, h2 + p, h3 + p, thead { break-after: avoid; }
  p, figure, tr, pre, .small > svg, .key { break-inside: avoid; }
  .plots { grid-template-columns: repeat(auto-fit, minmax(54mm, 1fr)); }
  .small { grid-template-columns: repeat(5, 1fr); }
  pre { white-space: pre-wrap; }
  .badge, .bar svg, header { print-color-adjust: exact; -webkit-print-color-adjust: exact; }
}
"""
    + "\n".join(
        f".{verdict} {{ border-color: {colour}; }} .{verdict} .badge {{ background: {colour}; }}"
        for verdict, colour in VERDICT_COLOURS.items()
    )
    + "\n"
)
