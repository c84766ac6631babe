"""The battery: measured voltage, chemistry, and the voltages of warning and stop."""

import math
from dataclasses import dataclass

from robot_driver.bringup.bench import Bench, CannotTell
from robot_driver.guided import Choice, Guide

LISTENING = 1.0  # s


@dataclass(frozen=True)
class Chemistry:
    """Voltages of one cell (V): its range, and those of warning and stop."""

    lowest: float
    highest: float
    warn: float
    stop: float


# Sources: data sheets of lithium polymer packs (4.2 V full, damage below 3.0 V) and of NiMH cells (1.0 V at their end).
KINDS = {
    "lipo2": (2, Chemistry(3.0, 4.25, 3.5, 3.3), "lithium, 2 cells (7.4 V)"),
    "lipo3": (3, Chemistry(3.0, 4.25, 3.5, 3.3), "lithium, 3 cells (11.1 V)"),
    "lipo4": (4, Chemistry(3.0, 4.25, 3.5, 3.3), "lithium, 4 cells (14.8 V)"),
    "lipo6": (6, Chemistry(3.0, 4.25, 3.5, 3.3), "lithium, 6 cells (22.2 V)"),
    "nimh6": (6, Chemistry(0.95, 1.55, 1.1, 1.0), "NiMH, 6 cells (7.2 V)"),
    "nimh10": (10, Chemistry(0.95, 1.55, 1.1, 1.0), "NiMH, 10 cells (12 V)"),
}


@dataclass(frozen=True)
class Battery:
    """The voltage now (V; NaN if not measured), and those of warning and stop (0: never)."""

    voltage: float
    warn: float = 0.0
    stop: float = 0.0


def find_battery(bench: Bench, guide: Guide) -> Battery:
    """Ask for the battery type. Raises CannotTell if it does not match the measured voltage."""
    bench.run(LISTENING)
    bench.ticks  # noqa: B018 - raises where the controller is silent
    assert bench.latest is not None
    voltage = float(bench.latest.battery_voltage)
    if not math.isfinite(voltage):
        guide.say("battery.unknown", "This controller does not report the battery's voltage: nothing is watched.")
        return Battery(voltage)
    choices = [Choice(key, f"{text}: {stop_of(key):.1f} V is empty") for key, (_, _, text) in KINDS.items()]
    choices.append(Choice("other", "another one, or a power supply: no voltage is watched"))
    kind = guide.ask("battery.kind", f"The controller measures {voltage:.1f} V. What is it fed by?", tuple(choices))
    if kind == "other":
        return Battery(voltage)
    cells, chemistry, text = KINDS[kind]
    if not chemistry.lowest <= voltage / cells <= chemistry.highest:
        raise CannotTell(
            f"{voltage:.1f} V is not what {text} can have ({cells * chemistry.lowest:.1f} to "
            f"{cells * chemistry.highest:.1f} V). Measure it with a voltmeter"
        )
    return Battery(voltage, round(cells * chemistry.warn, 2), round(cells * chemistry.stop, 2))


def stop_of(kind: str) -> float:
    """Return the voltage at which to stop (V)."""
    cells, chemistry, _ = KINDS[kind]
    return cells * chemistry.stop
