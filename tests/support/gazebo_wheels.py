"""Two wheels under a body that slip as Gazebo's DiffDrive and WheelSlip systems have them, and nothing more of Gazebo.

Written from the documentation of WheelSlip: a wheel that spins at w slips by C |r w| F / N under the force F, along
itself and across, each with its own compliance C. DiffDrive turns the wheels at the commanded speeds. The body's
mass is over the axle; what else carries it slides.
"""

from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np

from cmr.recordings.signal import Floats

NAMES = ("slip_compliance_lateral", "slip_compliance_longitudinal", "wheel_normal_force", "wheel_radius")


class Wheel(NamedTuple):
    """The settings of a wheel in WheelSlip: two compliances, the load [N], the radius [m]."""

    lateral: float
    longitudinal: float
    load: float
    radius: float


def wheels_of(model: ElementTree.Element) -> tuple[Wheel, Wheel]:
    """Return both wheels, left and right, of a model into which the system was pasted."""
    [system] = [one for one in model.iter("plugin") if one.attrib["name"] == "gz::sim::systems::WheelSlip"]
    by_link = {wheel.attrib["link_name"]: wheel for wheel in system.findall("wheel")}
    left, right = (
        Wheel(*(float(str(by_link[f"{side}_wheel_link"].findtext(name))) for name in NAMES))
        for side in ("left", "right")
    )
    return left, right


def driven(wheels: tuple[Wheel, Wheel], width: float, mass: float, spins: Floats, dt: float) -> Floats:
    """Return the speed along and across [m/s] and the turn rate [rad/s] of the body, (n, 3), at the end of each step.

    `spins` (n, 2) are the speeds of both wheels [rad/s] in steps of `dt` [s]; they are `width` [m] apart. The body has
    the yaw inertia m b^2 / 4. Each step solves for the speeds at its end and for the forces along both wheels and
    across that bring them about.
    """
    half, inertia = width / 2.0, mass * width**2 / 4.0
    motion, now = np.zeros((len(spins), 3)), np.zeros(3)
    for step, turning in enumerate(spins.tolist()):
        rims = [wheel.radius * spin for wheel, spin in zip(wheels, turning, strict=True)]
        left, right = (wheel.longitudinal * abs(rim) / wheel.load for wheel, rim in zip(wheels, rims, strict=True))
        stiffness = sum(
            wheel.load / (wheel.lateral * abs(rim) or 1e-12) for wheel, rim in zip(wheels, rims, strict=True)
        )
        equations = np.array(
            [  # along, across, turn rate; forces along the left and right wheel, across
                [mass / dt, 0.0, 0.0, -1.0, -1.0, 0.0],
                [0.0, mass / dt, 0.0, 0.0, 0.0, -1.0],
                [0.0, 0.0, inertia / dt, half, -half, 0.0],
                [1.0, 0.0, -half, left, 0.0, 0.0],
                [1.0, 0.0, half, 0.0, right, 0.0],
                [0.0, 1.0, 0.0, 0.0, 0.0, 1.0 / stiffness],
            ]
        )
        along, across, rate = now
        known = [
            mass * (along / dt + across * rate),
            mass * (across / dt - along * rate),
            inertia * rate / dt,
            *rims,
            0.0,
        ]
        now = np.linalg.solve(equations, known)[:3]
        motion[step] = now
    return motion
