"""Motion over the ground as described in the literature, but by no effect of the catalogue.

Each function is one kind of physics. Its parameter is 0 if it is absent. Symbols are those of `physics`.
"""

import math

from cmr.plant.compiling import compiled
from cmr.plant.parameters import PlantParameters

STRAIGHT = 1e-9  # m/s; at a smaller difference of both sides a path has no curvature


@compiled
def punctured(p: PlantParameters, s: float, t: float) -> float:
    """Return the rolling radius as a share of that of a full tyre: 1 - c on the left after T.

    N. Persson, F. Gustafsson, M. Drevo, Indirect tire pressure monitoring using sensor fusion, SAE 2002-01-1250.
    """
    return 1.0 - p.puncture if s > 0.0 and t >= p.puncture_time else 1.0


@compiled
def scrubbing_width(p: PlantParameters, v_left: float, v_right: float) -> float:
    """Return the base width as a share of its own: 1 + c / (1 + k sqrt(abs(lambda))), lambda = (v_r + v_l)/(v_r - v_l).

    The centres about which the wheels of skid-steered robots turn come nearer as the circle gets wider. T. Wang and
    others, Analysis and experimental kinematics of a skid-steering wheeled robot based on a laser scanner sensor,
    Sensors 15, 2015, 9681-9702.
    """
    if p.curvature_slip == 0.0 or abs(v_right - v_left) < STRAIGHT:
        return 1.0
    curvature = abs((v_right + v_left) / (v_right - v_left))
    return 1.0 + p.curvature_slip / (1.0 + p.curvature_slip_scale * math.sqrt(curvature))


@compiled
def understeered(p: PlantParameters, w: float, v: float) -> float:
    """Return the yaw rate of a robot whose tyres slip sideways: w / (1 + K v^2).

    T. D. Gillespie, Fundamentals of Vehicle Dynamics, SAE, 1992, chapter 6 (yaw velocity gain).
    """
    return w / (1.0 + p.understeer * v * v)


@compiled
def spun(p: PlantParameters, x: float, y: float) -> float:
    """Return the forward speed as a share of that of the wheels: 1 - c inside a disc of the floor where they slip.

    R. Gonzalez, K. Iagnemma, Slippage estimation and compensation for planetary exploration rovers, Journal of Field
    Robotics 35, 2018, 564-577.
    """
    if p.slippery_spot == 0.0:
        return 1.0
    inside = (x - p.slippery_spot_x) ** 2 + (y - p.slippery_spot_y) ** 2 < p.slippery_spot_radius**2
    return 1.0 - p.slippery_spot if inside else 1.0


@compiled
def broken_away(p: PlantParameters, v: float, w: float) -> float:
    """Return the sideways speed of tyres that slide once v w exceeds their grip: -k (abs(v w) - a0) sign(v w) [m/s].

    R. Balakrishna, A. Ghosal, Modeling of slip for wheeled mobile robots, IEEE Transactions on Robotics and Automation
    11, 1995, 126-132.
    """
    lateral = v * w
    beyond = max(0.0, abs(lateral) - p.breakaway_skid_from)
    return -p.breakaway_skid * math.copysign(beyond, lateral)


@compiled
def carpeted(p: PlantParameters, theta: float, v: float) -> tuple[float, float]:
    """Return the speeds ahead and sideways with which the pile of a carpet carries the robot along: c abs(v) [m/s].

    D. Goel, E. Eade, P. Fong, M. E. Munich (iRobot), Carpet drift estimation using differential sensors or visual
    measurements, US patent 9,223,312, 2015.
    """
    if p.carpet_drift == 0.0:
        return 0.0, 0.0
    angle = p.carpet_drift_direction - theta
    return p.carpet_drift * abs(v) * math.cos(angle), p.carpet_drift * abs(v) * math.sin(angle)
