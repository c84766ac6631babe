"""Physical quantities of CMR's messages, and the accepted units of each with their factors."""

import math

TURN = 2 * math.pi

# quantity: {accepted unit: its value in CMR's unit}; the first unit of each is CMR's.
UNITS: dict[str, dict[str, float]] = {
    "length": {"m": 1.0, "cm": 0.01, "mm": 0.001},
    "angle": {"rad": 1.0, "deg": TURN / 360},
    "turn_rate": {"rad/s": 1.0, "deg/s": TURN / 360},
    "wheel_speed": {"rad/s": 1.0, "deg/s": TURN / 360, "rpm": TURN / 60},
    "speed": {"m/s": 1.0, "mm/s": 0.001},
    "drive": {"duty": 1.0, "percent": 0.01},
    "ticks": {"ticks": 1.0, "ticks/row": 1.0},
    "current": {"A": 1.0, "mA": 0.001},
    "voltage": {"V": 1.0, "mV": 0.001},
    "temperature": {"deg C": 1.0},
}


def units(quantity: str, *, wheel_radius: float, full_scale: float | None) -> dict[str, float]:
    """Return the accepted units of a quantity, each with its value in CMR's unit.

    Wheels may also be given in m/s, converted to rad/s by `wheel_radius` [m]; and if `full_scale`, the wheel speed at
    full drive [rad/s], is declared, drives may be given as commanded wheel speeds.
    """
    known = dict(UNITS[quantity])
    if quantity == "wheel_speed":
        known["m/s"] = 1 / wheel_radius
    if quantity == "drive" and full_scale is not None:
        known |= {"rad/s": 1 / full_scale, "m/s": 1 / (wheel_radius * full_scale)}
    return known
