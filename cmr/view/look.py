"""The page's look beyond viser's: title, legend, time bar, and layout on phones.

Viser inserts the HTML of a panel unchanged. So its styles apply to the whole page, elements with fixed position overlay
the scene, and an image that fails to load can run the script that labels inputs and accepts dropped files.
"""

from collections.abc import Sequence

from cmr.report.markup import Html, joined, tag
from cmr.view.data.log_index import Mark
from cmr.view.data.state import ViewState
from cmr.view.inputs import plain
from cmr.view.opening import LARGEST_LOG, too_large
from cmr.view.picture import BLUE, COLOURS, GREEN, GREY, PURPLE, RED, YELLOW, predicted, waypoints
from cmr.view.stage import FENCE_COLOUR

GO_TO = "go to"  # label of the input for a time
TITLE = "CMR: real and virtual robots"
PANEL = "388px"  # width of viser's large fixed panel
NARROW = "35em"  # window width below which viser puts the panel at the bottom
PANEL_SHARE = 0.36  # share of the window's height covered by the bottom panel
LEGEND = (
    (YELLOW, "real robot"),
    (BLUE, "virtual robot"),
    (GREEN, "simulated twin"),
    (GREY, "silent robot"),
    (RED, "planned path"),
    (PURPLE, "predicted paths"),
    (FENCE_COLOUR, "geofence"),
)
ICON = (
    "data:image/svg+xml,%3Csvg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 16 16'%3E"
    "%3Cpath d='M1 3h9l5 5-5 5H1z' fill='%23f2b705'/%3E%3C/svg%3E"
)
PURPLE_CSS = "rgb({},{},{})".format(*PURPLE)
STYLE = f"""
.mantine-ActionIcon-root {{ display: none; }}
.mantine-Text-root, .mantine-Slider-markLabel {{ color: #495057 !important; }}
.mantine-Button-root[style*="red"] {{ background: #c92a2a !important; }}
.mantine-Button-root[style*="gray"] {{ background: #5c636a !important; }}
.mantine-Button-root:not([style*="red"]):not([style*="gray"]) {{ background: #1864ab !important; }}
.cmr-name {{ position: absolute; width: 1px; height: 1px; overflow: hidden; clip-path: inset(50%); }}
.cmr-legend, .cmr-time {{ position: fixed; left: 0; z-index: 5; font: 13px/1.4 sans-serif; color: #222; }}
.cmr-legend {{ bottom: 34px; left: 8px; padding: 6px 10px; border-radius: 4px; pointer-events: none; }}
.cmr-legend, .cmr-time {{ background: #ffffffd9; }}
.cmr-legend i {{ display: inline-block; width: 14px; height: 10px; margin-right: 6px; border-radius: 2px; }}
.cmr-investigation {{ position: fixed; top: 8px; left: 8px; z-index: 5; width: 29em; pointer-events: none; }}
.cmr-investigation {{ font: 13px/1.4 sans-serif; color: #222; background: #ffffffe6; border-radius: 4px; }}
.cmr-investigation {{ padding: 8px 12px; box-shadow: 0 1px 4px #0003; }}
.cmr-investigation h2 {{ font-size: 14px; margin: 0 0 4px; }}
.cmr-investigation p {{ margin: 2px 0; }}
.cmr-investigation strong {{ color: #006b4e; }}
.cmr-investigation ul {{ list-style: none; margin: 6px 0; padding: 0; }}
.cmr-investigation li {{ display: flex; align-items: center; gap: 8px; height: 20px; }}
.cmr-investigation li span {{ flex: 0 0 13.5em; overflow: hidden; text-overflow: ellipsis; white-space: nowrap; }}
.cmr-investigation li s {{ flex: 1; height: 12px; border-radius: 3px; background: #e9e4ef; text-decoration: none; }}
.cmr-investigation li b {{ display: block; height: 100%; border-radius: 3px; background: {PURPLE_CSS}; }}
.cmr-investigation li b {{ width: var(--to); animation: cmr-shrink 0.8s ease-out; }}
.cmr-investigation li em {{ flex: 0 0 3.6em; text-align: right; font-style: normal; }}
@keyframes cmr-shrink {{ from {{ width: var(--from); }} }}
@media (prefers-reduced-motion: reduce) {{ .cmr-investigation li b {{ animation: none; }} }}
.cmr-time {{ bottom: 0; right: {PANEL}; height: 26px; cursor: pointer; }}
.cmr-time b, .cmr-time u {{ position: absolute; top: 0; height: 100%; pointer-events: none; }}
.cmr-time b {{ left: 0; background: #1f4fd855; border-right: 2px solid #1f4fd8; }}
.cmr-time u {{ width: 6px; margin-left: -3px; pointer-events: auto; border-left: 2px solid #222; }}
.cmr-time span {{ position: absolute; right: 8px; top: 4px; pointer-events: none; }}
[data-dock-tab] {{ padding-left: 5px !important; padding-right: 5px !important; }}
.cmr-note {{ position: fixed; top: 40%; left: 50%; transform: translate(-50%); max-width: 30em; z-index: 1000; }}
.cmr-note {{ font: 14px/1.4 sans-serif; color: #fff; background: #c92a2a; border-radius: 4px; padding: 8px 12px; }}
.cmr-dropping::after {{ content: 'Drop the log to open it'; position: fixed; inset: 0; z-index: 9; }}
.cmr-dropping::after {{ pointer-events: none; background: #1f4fd833; border: 4px dashed #1f4fd8; }}
.cmr-dropping::after {{ font: 24px sans-serif; padding: 2em; }}
@media (max-width: {NARROW}) {{
  .mantine-Paper-root[style*="position: fixed"] {{ width: 100% !important; max-height: {PANEL_SHARE:.0%} !important; }}
  .mantine-Paper-root[style*="position: fixed"] [style*="width: 20em"] {{ width: 100% !important; }}
  .cmr-time {{ top: 0; bottom: auto; right: 0; }}
  .cmr-investigation {{ top: 30px; left: 4px; width: min(26em, 100vw - 125px); padding: 4px 8px; }}
  .cmr-investigation {{ font-size: 11px; line-height: 1.3; }}
  .cmr-investigation h2 {{ font-size: 12px; }}
  .cmr-investigation li {{ height: 16px; gap: 5px; }}
  .cmr-investigation li:nth-child(n+5) {{ display: none; }}
  .cmr-investigation li span {{ flex-basis: 9.5em; }}
  .cmr-legend {{ top: 30px; bottom: auto; right: 4px; left: auto; font-size: 11px; }}
}}
"""
CLOSING = 1000.0  # ms
BUSY = "Nothing was sent. Enter the token first, or wait until the other file is there; then drop this one again."
# The first function labels viser's inputs, for screen readers and for cmrJump, which jumps to a time: React notices
# changes of its inputs only in this way. Handlers for the whole window are installed once, although each page has this
# script. A dropped file goes into viser's own upload input. Viser ignores keys while a visitor types, and a list keeps
# the focus after a choice, so Esc must also stop there, unless it closes the list. In doubt it stops, including any Esc
# within CLOSING after one that closed something.
SCRIPT = f"""
document.title = '{TITLE}';
document.querySelector('link[rel=icon]').href = this.dataset.icon;
const nameInputs = () => document.querySelectorAll('.mantine-Flex-root').forEach((row) => {{
  const name = row.querySelector('label')?.innerText.trim();
  if (name) row.querySelectorAll('input, [role=slider]').forEach((one) => one.setAttribute('aria-label', name));
}});
const nameAll = () => {{
  nameInputs();
  const name = (what, attribute, text) =>
    document.querySelectorAll(what).forEach((one) => one.setAttribute(attribute, text));
  name('.mantine-Notification-closeButton', 'aria-label', 'close');
  name('[role=progressbar]', 'aria-label', 'how much has been sent');
  name('img:not([alt])', 'alt', 'picture of a camera');
}};
document.getElementById('root').setAttribute('role', 'main');
nameAll();
window.cmrJump = (event) => {{
  const bar = event.currentTarget, left = bar.getBoundingClientRect().left;
  const input = document.querySelector('input[aria-label="{GO_TO}"]');
  const seconds = (event.clientX - left) / bar.clientWidth * bar.dataset.seconds;
  Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, 'value').set.call(input, seconds.toFixed(1));
  input.dispatchEvent(new Event('input', {{bubbles: true}}));
}};
if (!window.cmrIsThere) {{
  window.cmrIsThere = true;
  new MutationObserver(nameAll).observe(document.body, {{childList: true, subtree: true}});
  const note = (text) => {{
    const box = document.body.appendChild(document.createElement('div'));
    Object.assign(box, {{className: 'cmr-note', textContent: text}}).setAttribute('role', 'alert');
    setTimeout(() => box.remove(), 8000);
  }};
  const guard = (event, act) => {{
    if (![...event.dataTransfer.types].includes('Files')) return;
    event.preventDefault();
    act(document.querySelector('input[type=file]'));
  }};
  window.addEventListener('dragover', (event) => guard(event, () => document.body.classList.add('cmr-dropping')));
  window.addEventListener('dragleave', () => document.body.classList.remove('cmr-dropping'));
  window.addEventListener('drop', (event) => guard(event, (input) => {{
    document.body.classList.remove('cmr-dropping');
    if (!input || input.parentElement.querySelector('button').disabled) return note('{BUSY}');
    input.files = event.dataTransfer.files;
    input.dispatchEvent(new Event('change', {{bubbles: true}}));
  }}));
  let closed = -Infinity;
  const isOpen = () => [...document.querySelectorAll('[role=listbox], [role=menu], [role=dialog]')].some(
    (one) => one.getClientRects().length);
  window.addEventListener('keydown', (event) => {{
    if (event.key !== 'Escape' || !event.isTrusted || !event.target.matches('input, textarea')) return;
    if (isOpen() && event.timeStamp - closed > {CLOSING}) closed = event.timeStamp;
    else document.documentElement.dispatchEvent(new KeyboardEvent('keydown', {{key: 'Escape', code: 'Escape'}}));
  }}, true);
  document.addEventListener('change', (event) => {{
    if (event.target.type !== 'file' || !(event.target.files[0]?.size > {LARGEST_LOG})) return;
    event.stopImmediatePropagation();
    note('{too_large()}');
  }}, true);
}}
"""


def page_look() -> str:
    """Return the HTML that sets the page's title and style."""
    script = tag("img", hidden="", alt="", src="data:,", data_icon=ICON, onerror=SCRIPT)
    heading = tag("h1", TITLE, class_="cmr-name")  # for screen readers
    return plain(joined(tag("style", Html(STYLE)), script, heading))


def legend(state: ViewState, has_fence: bool) -> str:
    """Return the legend for the current scene."""
    robots = state.present()
    shown = {colour for origin, colour in COLOURS.items() if (robots.origin == origin).any()}
    shown |= {GREY} if robots.silent.any() else set()
    shown |= {RED} if len(waypoints(state, robots).ends) else set()
    shown |= {PURPLE} if len(predicted(state, robots).ends) else set()
    shown |= {FENCE_COLOUR} if has_fence else set()
    entries = [(_css(colour), name) for colour, name in LEGEND if colour in shown]
    lines = [tag("div", tag("i", style=f"background:{colour}"), name) for colour, name in entries]
    return plain(tag("div", *lines, class_="cmr-legend", role="note", aria_label="legend")) if entries else ""


def time_bar(now: float, end: float, marks: Sequence[tuple[float, Mark]]) -> str:
    """Return the bar of a log's time over the whole width: `now` of `end` [s], and its events, each at its time [s]."""
    ticks = [
        tag("u", style=f"left:{100.0 * at / end:.2f}%", title=f"{at:.1f} s: {mark.sentence[:80]}") for at, mark in marks
    ]
    bar = tag(
        "div",
        tag("b", style=f"width:{100.0 * min(now / end, 1.0):.2f}%"),
        *ticks,
        tag("span", f"{now:.1f} of {end:.1f} s"),
        class_="cmr-time",
        onclick="cmrJump(event)",
        data_seconds=f"{end:.1f}",
        role="slider",
        aria_label="time [s]",
        aria_valuemin=0,
        aria_valuemax=f"{end:.1f}",
        aria_valuenow=f"{now:.1f}",
        tabindex=0,
    )
    return plain(bar)


def _css(colour: tuple[int, int, int]) -> str:
    return "rgb({},{},{})".format(*colour)
