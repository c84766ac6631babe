"""The terminal display of cmr-teleop: the demand, and the robot's response."""

from io import StringIO
from math import isnan

from rich.console import Console
from rich.markup import escape
from rich.panel import Panel
from rich.table import Table

from cmr.model.body import forward, turn
from cmr.msg import motor_feedback_t
from cmr.teleop.drive import OLD, Drive
from cmr.world.view import VIRTUAL

BAR = 10  # characters of a duty of 1
UNKNOWN = "-"


def speeds(pair: tuple[float, float] | None) -> str:
    """Return a speed [m/s] and a turn rate [rad/s] as a text."""
    return f"{pair[0]:+6.2f} m/s {pair[1]:+6.2f} rad/s" if pair else UNKNOWN


def bar(duty: float) -> str:
    """Return a duty as a number with a bar: to the right ahead, to the left back."""
    filled = min(round(abs(duty) * BAR), BAR)
    back, ahead = (("#" * filled).rjust(BAR), "") if duty < 0.0 else ("", "#" * filled)
    return f"{duty:+5.2f} {back:>{BAR}}|{ahead:<{BAR}}"


def measured(drive: Drive, utime: int) -> tuple[float, float] | None:
    """Return the robot's speed [m/s] and turn rate [rad/s] from WORLD_STATE; None if unknown."""
    me, model = drive.pilot.me, drive.pilot.model
    if me is None or model is None or abs(utime - me.utime) > OLD:
        return None
    wheels = float(me.state.psi_left), float(me.state.psi_right)
    return float(forward(*wheels, model)), float(turn(*wheels, model))


def feedback(drive: Drive, utime: int) -> motor_feedback_t | None:
    """Return the driver's last report if it is recent."""
    last = drive.measured.feedback
    return last if last is not None and abs(utime - last.utime) <= OLD else None


def battery(report: motor_feedback_t | None) -> str:
    """Return the battery's voltage."""
    return UNKNOWN if report is None or isnan(report.battery_voltage) else f"{report.battery_voltage:.1f} V"


def fence(drive: Drive) -> str:
    """Return the distance of the robot to its geofence, as text."""
    if drive.pilot.left_fence:
        return "[bold red]left[/]"
    kept = drive.pilot.fence
    return f"{kept[0]:.2f} m to the border, {kept[1]:g} m is the margin" if kept else "none"


def owner(drive: Drive, utime: int) -> str:
    """Return the name of the process that commands the robot."""
    report = drive.measured.owner
    if report is None or abs(utime - report.utime) > 2 * OLD:
        return "unknown: no driver or simulator reports"
    return escape(report.owner) or "nobody"


def frame(drive: Drive, hands: str, utime: int, size: tuple[int, int]) -> str:
    """Return the screen for a terminal of this size; `hands` says what is held and what it does."""
    columns, lines = size
    table = Table.grid(padding=(0, 2))
    report = feedback(drive, utime)
    me = drive.pilot.me
    kind = "" if me is None else " (virtual)" if me.origin == VIRTUAL else " (real)"
    table.add_row("wanted", f"{speeds(drive.hand.wanted)}   at {100 * drive.hand.share:.0f} % of the speed")
    table.add_row("measured", speeds(measured(drive, utime)))
    for side, asked, applied in zip(
        ("left", "right"),
        drive.duties,
        (report.applied_left, report.applied_right) if report else (None, None),
        strict=True,
    ):
        table.add_row(f"duty {side}", f"{bar(asked)}   applied {UNKNOWN if applied is None else f'{applied:+5.2f}'}")
    stop = drive.button.text or drive.pilot.estop_reason
    table.add_row("stop", f"[bold red]ENGAGED[/] by {escape(stop)}" if stop else "not engaged")
    table.add_row("owner", owner(drive, utime))
    table.add_row("geofence", fence(drive))
    table.add_row("battery", battery(report))
    if drive.recorder is not None:
        table.add_row("recorded", f"{drive.recorder.seconds:.1f} s")
    waiting = drive.pilot.left_fence or (f"Waiting for {drive.waiting_for}." if drive.waiting_for else "")
    table.add_row("", f"[yellow]{escape(waiting)}[/]" if waiting else "[green]ready[/]")
    table.add_row("", escape(hands))
    drawn = StringIO()
    console = Console(file=drawn, width=max(columns, 20), height=lines, force_terminal=True, color_system="standard")
    console.print(Panel(table, title=f"robot {drive.pilot.robot_id}{kind}", title_align="left"), end="")
    return "\n".join(drawn.getvalue().rstrip("\n").split("\n")[: max(lines - 1, 1)])
