"""`cmr-export --to mjcf`: a MuJoCo robot with the calibrated wheels, motors and body.

A body on two wheels, free in x, y and heading, and held upright. The model of each side, domega = (K2/K3) (duty - K1
psi), is MuJoCo's `dcmotor`: stall torque (K2/K3) I and no-load speed 1/K1, where I is the inertia of one side: the
wheel of radius r_i, and its part of a body of mass m and yaw inertia J,

    I = I_wheel,i + r_i^2 (m / 4 + J / b^2),

the same on both sides: I_wheel,i compensates for wheels of different size. J is chosen so that one side pushes back the
other by `motor_coupling` c, or not at all:

    r_left r_right (m / 4 - J / b^2) = c I.

The mass itself makes no difference to the motion.
"""

from dataclasses import dataclass
from math import inf

from cmr.exporting.carried import MJCF, what_is_carried
from cmr.exporting.robot import ExportedRobot
from cmr.model.extended.statements import SIDES

MASS = 2.0  # kg
WHEEL_INERTIA = 0.02  # of m r^2, for the larger wheel: small, so that a body exists for any coupling
WHEEL_MASS = 1e-3  # kg; its inertia is that of the joint's armature
LEAST_INERTIA = 1e-8  # kg m^2, since MuJoCo refuses 0
FOURTH_ORDER = "RK4"
TIME_STEP = 0.001  # s
STIFFNESS = 0.002  # s, time constant of contacts and of joint friction: as stiff as this time step allows
HARD = "0.9999 0.9999 0.001 0.5 2"  # joint friction holds a wheel: MuJoCo's usual 0.9 lets it creep
GRAVITY = 9.81  # m/s^2


@dataclass(frozen=True)
class Side:
    """A wheel and its motor: radius [m], inertia of the side, and of the wheel alone [kg m^2].

    The motor has a stall torque [N m] and a no-load speed [rad/s].
    """

    name: str
    side: float
    radius: float
    inertia: float
    of_wheel: float
    stall_torque: float
    no_load_speed: float


def mjcf(robot: ExportedRobot) -> str:
    """Return the MuJoCo model of a robot.

    Raises ValueError if no body has the robot's coupling of both sides.
    """
    radius = _radius(robot)
    body, accelerated = _inertias(robot)
    sides = [_side(robot, name, side, body, accelerated) for name, side in SIDES.items()]
    carried = "\n".join(what_is_carried(MJCF, robot)).replace("--", "- -")
    motors = "\n".join(_motor(robot, side) for side in sides)
    return f"""\
<!--
Robot {robot.robot_id} of Calibrated Mixed Reality, as it was calibrated: written by cmr-export.
For MuJoCo 4 or later. ctrl is {_what_ctrl_is(robot)}, left and right.

{carried}
-->
<mujoco model="robot_{robot.robot_id}">
  <option timestep="{TIME_STEP}" integrator="{_integrator(robot)}" cone="elliptic" impratio="10"
      gravity="{_tilted(robot, sides, "slope_x")} {_tilted(robot, sides, "slope_y")} {-GRAVITY}"/>
  <default>
    <geom friction="2 0 0" condim="3" solref="{STIFFNESS} 1"/>
  </default>
  <worldbody>
    <geom name="floor" type="plane" size="50 50 0.1" rgba="0.9 0.9 0.9 1"/>
    <light pos="0 0 5"/>
{_body(robot, sides, radius, body)}
  </worldbody>
  <actuator>
{motors}
  </actuator>
  <sensor>
    <jointpos name="encoder_left" joint="left"/>
    <jointpos name="encoder_right" joint="right"/>
    <gyro name="gyro" site="body"/>
    <framepos name="position" objtype="site" objname="body"/>
    <framequat name="orientation" objtype="site" objname="body"/>
  </sensor>
</mujoco>
"""


def _body(robot: ExportedRobot, sides: list[Side], radius: float, yaw_inertia: float) -> str:
    """Return the body with its wheels; `yaw_inertia` [kg m^2] is that of both together."""
    width = robot.value("base_width")
    inertia = yaw_inertia - 2.0 * WHEEL_MASS * (width / 2.0) ** 2
    wheels = "\n".join(_wheel(robot, side, radius) for side in sides)
    return f"""\
    <body name="robot" pos="0 0 {radius!r}">
      <joint name="x" type="slide" axis="1 0 0"/>
      <joint name="y" type="slide" axis="0 1 0"/>
      <joint name="z" type="slide" axis="0 0 1"/>
      <joint name="theta" type="hinge" axis="0 0 1"/>
      <inertial pos="0 0 0" mass="{MASS - 2.0 * WHEEL_MASS!r}" diaginertia="{inertia!r} {inertia!r} {inertia!r}"/>
      <geom name="body" type="box" size="{0.45 * width:.4g} {0.4 * width:.4g} 0.01"
          contype="0" conaffinity="0" mass="0" rgba="0.3 0.5 0.8 1"/>
      <site name="body"/>
{wheels}
    </body>"""


def _integrator(robot: ExportedRobot) -> str:
    """Return the integrator: fourth order, except where commands are delayed, since it would read them within its
    steps.

    MuJoCo's others use the speed at a step's end for the whole step: wheels are half a step ahead of their speeds, and
    slip accordingly.
    """
    return "implicitfast" if robot.value("command_delay") > 0.0 else FOURTH_ORDER


def _filter(robot: ExportedRobot) -> str:
    """Return the filter for the lag of the voltage.

    The exact filter shortens the slope taken at a step's beginning. With fourth order, the slope is already the step's
    mean: shortened again, the filter would be half a step too slow.
    """
    return "filter" if _integrator(robot) == FOURTH_ORDER else "filterexact"


def _what_ctrl_is(robot: ExportedRobot) -> str:
    return "the duty, -1 to 1" if robot.controller is None else "the commanded wheel speed [rad/s]"


def _inertias(robot: ExportedRobot) -> tuple[float, float]:
    """Return the yaw inertia of the body that gives the robot's coupling, and the inertia of a side.

    Both are in kg m^2. In units of m b^2 and of m r^2, r being the mean radius and r (1 -+ a) those of the wheels, the
    equations of this module are j (p + c) = p / 4 - c (w + 1 / 4) and i = w + 1 / 4 + j, with p = 1 - a^2. The larger
    wheel has a share WHEEL_INERTIA of i if w = WHEEL_INERTIA + ((1 + a)^2 - 1) (1 / 4 + j).
    """
    coupling, width = robot.value("motor_coupling"), robot.value("base_width")
    unequal = abs(robot.value("wheel_radius_asymmetry"))
    product, larger = 1.0 - unequal**2, (1.0 + unequal) ** 2 - 1.0
    without, by_wheels = 0.25 * (product - coupling) / (product + coupling), coupling / (product + coupling)
    room = 1.0 + larger * by_wheels
    wheels = (WHEEL_INERTIA + larger * (0.25 + without)) / room if room > 0.0 else inf
    yaw = without - by_wheels * wheels
    inertia = width**2 * MASS * yaw
    if not 2.0 * WHEEL_MASS * (width / 2.0) ** 2 < inertia < inf:
        raise ValueError(f"no body couples both sides by motor_coupling {coupling}: it would have no inertia")
    return inertia, MASS * _radius(robot) ** 2 * (wheels + 0.25 + yaw)


def _radius(robot: ExportedRobot) -> float:
    """Return the mean radius of the wheels [m]."""
    return robot.value("wheel_radius") * (1.0 + robot.value("wheel_radius_scale"))


def _side(robot: ExportedRobot, name: str, side: float, body: float, accelerated: float) -> Side:
    value = robot.value
    radius = _radius(robot) * (1.0 + side * value("wheel_radius_asymmetry"))
    of_wheel = accelerated - radius**2 * (MASS / 4.0 + body / value("base_width") ** 2)
    gain = 1.0 + side * value("motor_gain_asymmetry")
    back_emf = value("k1") * (1.0 + side * value("back_emf_asymmetry"))
    stall_torque = value("k2_over_k3") * accelerated * gain
    return Side(name, side, radius, accelerated, of_wheel, stall_torque, gain / back_emf)


def _wheel(robot: ExportedRobot, side: Side, mean_radius: float) -> str:
    armature = side.of_wheel - LEAST_INERTIA
    friction, drag = (robot.value(name) * side.inertia for name in ("coulomb_friction", "quadratic_drag"))
    place = f"0 {side.side * robot.value('base_width') / 2.0!r} {side.radius - mean_radius!r}"
    return f"""\
      <body name="wheel_{side.name}" pos="{place}">
        <joint name="{side.name}" type="hinge" axis="0 1 0" armature="{armature!r}"
            frictionloss="{friction!r}" solreffriction="{STIFFNESS} 1" solimpfriction="{HARD}"
            damping="{_back_emf_of_joint(robot, side)!r} {drag!r} 0"/>
        <inertial pos="0 0 0" mass="{WHEEL_MASS}" diaginertia="{LEAST_INERTIA} {LEAST_INERTIA} {LEAST_INERTIA}"/>
        <geom name="wheel_{side.name}" type="sphere" size="{side.radius!r}" rgba="0.2 0.2 0.2 1"/>
      </body>"""


def _motor(robot: ExportedRobot, side: Side) -> str:
    """Return the motor of a side: MuJoCo's own; with a voltage lag, a filter and a torque instead."""
    value, full = robot.value, _full(robot)
    highest = full * (1.0 if _back_emf_of_joint(robot, side) else min(1.0, value("saturation")))
    largest = _largest_torque(robot, side)
    attributes = [f'name="{side.name}" joint="{side.name}" ctrlrange="{-highest!r} {highest!r}"']
    if value("electrical_lag") > 0.0:
        kind = "general"
        back_emf = 0.0 if _back_emf_of_joint(robot, side) else side.stall_torque / side.no_load_speed
        attributes += [
            f'dyntype="{_filter(robot)}" dynprm="{value("electrical_lag")!r}"',
            f'gainprm="{side.stall_torque / full!r}" biastype="affine" biasprm="0 0 {-back_emf!r}"',
        ]
        if largest < inf:
            attributes.append(f'forcerange="{-largest!r} {largest!r}"')
    else:
        kind = "dcmotor"
        attributes.append(f'nominal="{full!r} {side.stall_torque!r} {side.no_load_speed!r}"')
        if largest < inf:
            attributes.append(f'saturation="{largest!r} 0 0"')
    if value("command_delay") > 0.0:
        steps = round(value("command_delay") / TIME_STEP)
        # A command takes effect at the first step after its delay.
        attributes.append(f'delay="{max(steps - 0.5, 0.0) * TIME_STEP!r}" nsample="{steps + 1}"')
    return "\n        ".join([f"    <{kind}", *attributes]) + "/>"


def _full(robot: ExportedRobot) -> float:
    """Return the command for full drive."""
    return 1.0 if robot.controller is None else robot.controller.top_wheel_speed


def _back_emf_of_joint(robot: ExportedRobot, side: Side) -> float:
    """Return the back-EMF as damping of the wheel's joint [N m s], 0.0 where it belongs to the motor.

    A lagging voltage is saturated after the lag: so is the motor's torque, if its back-EMF is not part of it.
    """
    is_cut = robot.value("saturation") < 1.0 and robot.value("current_limit") == inf
    return side.stall_torque / side.no_load_speed if robot.value("electrical_lag") > 0.0 and is_cut else 0.0


def _largest_torque(robot: ExportedRobot, side: Side) -> float:
    """Return the torque limit of a motor [N m]."""
    if _back_emf_of_joint(robot, side):
        return side.stall_torque * robot.value("saturation")
    return robot.value("current_limit") * robot.value("k2_over_k3") * side.inertia


def _tilted(robot: ExportedRobot, sides: list[Side], slope: str) -> float:
    """Return the gravity [m/s^2] along the floor that has the effect of the slope on the wheels."""
    inertia = sum(side.inertia for side in sides) / 2.0
    radius = sum(side.radius for side in sides) / 2.0
    return -2.0 * inertia * robot.value(slope) / (MASS * radius) + 0.0
