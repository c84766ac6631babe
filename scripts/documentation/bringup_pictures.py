"""Draw a picture for each step of cmr bringup: what the person sees and does."""

import math
from collections.abc import Callable
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyArrowPatch, FancyBboxPatch, Rectangle

from robot_driver.bringup.floor import PLAN

BODY, WHEEL, ACTIVE, LINE = "#dfe7f2", "#4a5568", "#c1121f", "#2b6cb0"
WIDTH, HEIGHT, DOTS = 6.4, 2.6, 110  # inches, inches, dots per inch


def draw(step: str, path: Path) -> None:
    """Draw the picture of a step."""
    figure = Figure(figsize=(WIDTH, HEIGHT), dpi=DOTS, layout="constrained")
    axes = figure.add_subplot()
    axes.set_axis_off()
    axes.set_aspect("equal")
    STEPS[step](axes)
    axes.autoscale_view()
    axes.margins(0.04)
    figure.savefig(path)


def box(axes: Axes, x: float, y: float, width: float, height: float, text: str, colour: str = BODY) -> None:
    """Draw a box that contains a text."""
    axes.add_patch(FancyBboxPatch((x, y), width, height, boxstyle="round,pad=0.02", fc=colour, ec=WHEEL))
    axes.text(x + 0.5 * width, y + 0.5 * height, text, ha="center", va="center", fontsize=9)


def arrow(
    axes: Axes, start: tuple[float, float], end: tuple[float, float], bend: float = 0.0, colour: str = ACTIVE
) -> None:
    """Draw an arrow; a positive `bend` curves it to the right."""
    style = f"arc3,rad={bend}"
    axes.add_patch(
        FancyArrowPatch(start, end, connectionstyle=style, arrowstyle="-|>", mutation_scale=16, lw=2, color=colour)
    )


def robot(
    axes: Axes, x: float, y: float, heading: float = 0.0, size: float = 1.0, active: tuple[str, ...] = ()
) -> None:
    """Draw a robot from above, with `active` wheels in red."""
    turn = matplotlib.transforms.Affine2D().rotate(heading).translate(x, y) + axes.transData
    parts = [(Rectangle((-0.35, -0.3), 0.75, 0.6), BODY)]
    parts += [
        (Rectangle((-0.15, side * 0.36 - 0.05), 0.3, 0.1), ACTIVE if name in active else WHEEL)
        for name, side in (("left", 1), ("right", -1))
    ]
    for part, colour in parts:
        part.set(fc=colour, ec=WHEEL)
        part.set_x(part.get_x() * size)
        part.set_y(part.get_y() * size)
        part.set_width(part.get_width() * size)
        part.set_height(part.get_height() * size)
        axes.add_patch(part)
        part.set_transform(turn)
    nose = complex(x, y) + size * 0.55 * complex(math.cos(heading), math.sin(heading))
    arrow(axes, (x, y), (nose.real, nose.imag), colour=LINE)


def devices(axes: Axes) -> None:
    """Draw the computer's ports, and the devices that answer there."""
    box(axes, 0.0, 0.0, 1.5, 1.6, "computer")
    for y, text in ((1.05, "motor controller:\nRoboClaw, Roboteq, MBot"), (0.05, "gyro: KVH\n(or on the board)")):
        box(axes, 3.6, y, 2.4, 0.5, text)
        axes.plot([1.52, 3.58], [y + 0.25] * 2, color=WHEEL, lw=3)
        axes.text(2.55, y + 0.33, "identify?", ha="center", fontsize=8, color=LINE)


def motors(axes: Axes) -> None:
    """Draw a robot on a box with one wheel turning, from the side and from above."""
    box(axes, 0.3, 0.0, 1.2, 0.6, "box")
    axes.add_patch(Rectangle((0.1, 0.64), 1.6, 0.45, fc=BODY, ec=WHEEL))
    axes.add_patch(Circle((0.35, 0.55), 0.34, fc=ACTIVE, ec=WHEEL))
    axes.plot([-0.4, 2.2], [0.0, 0.0], color=WHEEL)
    arrow(axes, (0.0, 0.98), (0.72, 0.96), bend=-0.5)
    axes.text(0.9, 1.25, "the wheels are off the floor", ha="center", fontsize=9)
    robot(axes, 3.6, 0.65, active=("left",), size=1.3)
    arrow(axes, (3.3, 1.3), (3.95, 1.3))
    axes.text(4.05, 1.25, "left wheel, forward: lf", fontsize=9)
    axes.text(4.45, 0.6, "ahead", fontsize=9, color=LINE)


def ticks(axes: Axes) -> None:
    """Draw a wheel with tape, which is turned ten times, then seven."""
    axes.add_patch(Circle((0.8, 0.8), 0.75, fc=BODY, ec=WHEEL, lw=5))
    axes.add_patch(Rectangle((0.74, 1.25), 0.12, 0.34, fc=ACTIVE))
    axes.add_patch(Rectangle((0.74, 1.68), 0.12, 0.2, fc=ACTIVE))
    arrow(axes, (0.35, 1.2), (1.3, 1.1), bend=-0.45)
    axes.text(1.0, 1.72, "tape on the wheel and beside it", fontsize=9)
    axes.text(1.9, 1.05, "ten turns forward, counted aloud,", fontsize=9)
    axes.text(1.9, 0.75, "until both tapes are aligned again;", fontsize=9)
    axes.text(1.9, 0.45, "then seven, if no data sheet matches", fontsize=9)
    axes.set_xlim(-0.1, 5.0)


def stop(axes: Axes) -> None:
    """Draw the counts before the cable is unplugged, and after it is plugged in again."""
    axes.set_aspect("auto")
    axes.set_axis_on()
    axes.spines[["top", "right"]].set_visible(False)
    axes.plot([0.0, 0.15, 0.7], [0, 10, 120], color=LINE, lw=2)
    axes.plot([0.7, 0.95, 1.35, 1.5], [120, 165, 190, 190], color=WHEEL, lw=2, ls=":")
    axes.plot([1.5, 2.0], [190, 190], color=LINE, lw=2)
    axes.axvline(0.7, color=ACTIVE)
    axes.text(0.72, 15, "cable pulled", color=ACTIVE, fontsize=9)
    axes.axvline(1.5, color=ACTIVE)
    axes.text(1.52, 15, "plugged in again", color=ACTIVE, fontsize=9)
    axes.annotate("", (1.45, 190), (1.45, 120), arrowprops={"arrowstyle": "<->"})
    axes.text(1.43, 140, "gained", ha="right", fontsize=9)
    axes.set(xlabel="time", ylabel="counts", xticks=[], yticks=[])


def battery(axes: Axes) -> None:
    """Draw the voltages of a battery of three lithium cells, and those at which the driver warns and stops."""
    from robot_driver.bringup.supply import KINDS

    cells, chemistry, _ = KINDS["lipo3"]
    low, high = (cells * limit for limit in (chemistry.lowest, chemistry.highest))
    axes.set_aspect("auto")
    axes.add_patch(Rectangle((low, 0.0), high - low, 1.0, fc=BODY, ec=WHEEL))
    for volt, text, colour, side in (
        (cells * chemistry.stop, "stops", ACTIVE, "right"),
        (cells * chemistry.warn, "warns", LINE, "left"),
    ):
        axes.plot([volt, volt], [-0.1, 1.1], color=colour, lw=2)
        axes.text(volt, 1.2, f"{text} at {volt:.1f} V", ha=side, fontsize=9, color=colour)
    arrow(axes, (12.4, 1.5), (12.4, 1.0), colour=WHEEL)
    axes.text(12.4, 1.6, "measured", ha="center", fontsize=9)
    axes.text(low, -0.3, f"{low:.1f} V", ha="center", fontsize=9)
    axes.text(high, -0.3, f"{high:.2f} V", ha="center", fontsize=9)
    axes.set(xlim=(low - 0.4, high + 0.4), ylim=(-0.6, 2.1))


def gyro(axes: Axes) -> None:
    """Draw a robot that is turned once by hand, to its left."""
    axes.plot([0.0, 0.0], [-1.0, 1.0], color="#a0aec0", ls="--")
    axes.plot([-1.0, 1.3], [0.0, 0.0], color="#a0aec0", ls="--")
    robot(axes, 0.0, 0.0, size=1.1)
    arrow(axes, (0.85, 0.15), (-0.15, 0.85), bend=0.4)
    arrow(axes, (-0.25, 0.83), (-0.3, -0.8), bend=0.7)
    arrow(axes, (-0.2, -0.85), (0.85, -0.15), bend=0.4)
    axes.text(1.4, 0.35, "one turn to its left, seen from above,", fontsize=9)
    axes.text(1.4, 0.05, "on the spot, back to the mark,", fontsize=9)
    axes.text(1.4, -0.25, "in about five seconds", fontsize=9)
    axes.set_xlim(-1.2, 4.2)


def floor(axes: Axes) -> None:
    """Draw the drive on the floor, and the space that it needs."""
    axes.add_patch(Rectangle((-0.5, -0.5), 1.7, 1.3, fc="#f7fafc", ec=ACTIVE, ls="--", lw=2))
    axes.text(1.25, 0.7, "the fence: 1.2 m ahead, 0.8 m to the left,", fontsize=9, color=ACTIVE)
    axes.text(1.25, 0.58, "0.5 m to the right and behind", fontsize=9, color=ACTIVE)
    place, heading = 0j, 0.0
    for part in PLAN:
        end = place + part.ahead * complex(math.cos(heading), math.sin(heading))
        if part.ahead:
            arrow(axes, (place.real, place.imag), (end.real, end.imag), colour=LINE)
            middle = 0.5 * (place + end)
            axes.text(middle.real - 0.02, middle.imag + 0.03, f"{part.ahead:g} m", ha="right", fontsize=8)
        place, heading = end, heading + part.turn
    axes.text(place.real + 0.06, place.imag, "a quarter right", fontsize=8, va="center")
    axes.text(0.56, -0.03, "a quarter left", fontsize=8, va="center")
    robot(axes, 0.0, 0.0, size=0.25)
    axes.set_xlim(-0.6, 2.9)


STEPS: dict[str, Callable[[Axes], None]] = {
    "devices": devices,
    "motors": motors,
    "ticks": ticks,
    "stop": stop,
    "battery": battery,
    "gyro": gyro,
    "floor": floor,
}
