"""Gazebo's WheelSlip system, as far as it can represent the slip of a robot's wheels.

By its documentation, a wheel of radius r that spins at w under the load N slips by C |r w| F / N where a force F pushes
it along the ground. C is a compliance, one across and one along the wheel.

A body of mass m on two wheels has the load N = m g / 2 on each. Where it accelerates by a, each wheel pushes with
m a / 2, and where it turns by omega at the speed v, both hold it with m v omega. So wheels slip there

    along   C_longitudinal |v| a / g        against    longitudinal_slip a   here,
    across  C_lateral |v| v omega / g       against    lateral_skid v omega  here,

which agree at one speed, |v| = V: C = longitudinal_slip g / V and C = lateral_skid g / V. At other speeds slip there
is |v| / V of what it is here. V is half the top speed: a robot that speeds up from rest to the top speed v loses the
same way, longitudinal_slip v, in both. (As a side accelerates alone in CMR's model, the body has the yaw inertia
m b^2 / 4; another one slips more or less where it begins to turn.)

`turn_slip`, a base width that grows with the turn rate, is not represented: in Gazebo nothing resists a steady turn, so
wheels exert no force and do not slip.
"""

from cmr.exporting.robot import ExportedRobot

GRAVITY = 9.81  # m/s^2
SIDES = ("left", "right")


def compliances(robot: ExportedRobot, top_speed: float) -> tuple[float, float]:
    """Return the compliances across and along the wheels of a robot with a top speed [m/s], 0.0 for no slip."""
    per_second = GRAVITY / (top_speed / 2.0)
    return robot.value("lateral_skid") * per_second, robot.value("longitudinal_slip") * per_second


def wheel_slip(robot: ExportedRobot, top_speed: float, radii: tuple[float, float]) -> str:
    """Return the system for the wheels of a robot with a top speed [m/s] and these radii [m], left and right.

    Empty if they do not slip, or if the robot's mass is not known: motion alone does not give the load.
    """
    lateral, longitudinal = compliances(robot, top_speed)
    if robot.mass is None or not (lateral or longitudinal):
        return ""
    wheels = "\n".join(
        f"""\
  <wheel link_name="{side}_wheel_link">
    <slip_compliance_lateral>{lateral:.6g}</slip_compliance_lateral>
    <slip_compliance_longitudinal>{longitudinal:.6g}</slip_compliance_longitudinal>
    <wheel_normal_force>{robot.mass * GRAVITY / 2.0:.6g}</wheel_normal_force>
    <wheel_radius>{radius:.6g}</wheel_radius>
  </wheel>"""
        for side, radius in zip(SIDES, radii, strict=True)
    )
    return f'<plugin filename="gz-sim-wheel-slip-system" name="gz::sim::systems::WheelSlip">\n{wheels}\n</plugin>'
