"""`cmr-export --to sdf|urdf`: Gazebo's systems with the calibrated parameters: DiffDrive and WheelSlip."""

from math import inf

from cmr.exporting.carried import SDF, URDF, what_is_carried
from cmr.exporting.diff_drive import Described, calibrated
from cmr.exporting.robot import ExportedRobot
from cmr.exporting.wheel_slip import SIDES, wheel_slip

OF_SLIP = """\
WheelSlip needs wheels with one <collision> each, and the centre of mass over the axle. The first direction of
friction is to be along the axle: 0 0 1 if the wheel's cylinder is along z. {where}
Gazebo classic has the same system with filename="libWheelSlipPlugin.so" name="wheel_slip".
"""
OF_FRICTION = {
    SDF: "Put into each of these <collision>\n<surface><friction><ode><fdir1>0 0 1</fdir1></ode></friction></surface>.",
    URDF: "It is fdir1 below.",
}
SURFACES = "".join(f'<gazebo reference="{side}_wheel_link">\n  <fdir1>0 0 1</fdir1>\n</gazebo>\n' for side in SIDES)


def sdf(robot: ExportedRobot, said: Described) -> str:
    """Return the systems of Gazebo that drive the robot, to be pasted into its <model>."""
    slip = _slip(robot)
    return "\n".join(filter(None, [_comment(SDF, robot, slip), _diff_drive(robot, said), slip])) + "\n"


def urdf(robot: ExportedRobot, said: Described) -> str:
    """Return the snippet to paste into a URDF's <robot>: xacro properties, and Gazebo's systems."""
    known, slip = calibrated(robot), _slip(robot)
    plugins = "\n".join("  " + line for line in [*_diff_drive(robot, said).splitlines(), *slip.splitlines()])
    return f"""\
{_comment(URDF, robot, slip)}
<xacro:property name="wheel_separation" value="{known.separation:.6g}"/>
<xacro:property name="left_wheel_radius" value="{known.radius_left:.6g}"/>
<xacro:property name="right_wheel_radius" value="{known.radius_right:.6g}"/>
<gazebo>
{plugins}
</gazebo>
{SURFACES if slip else ""}"""


def _slip(robot: ExportedRobot) -> str:
    known = calibrated(robot)
    return wheel_slip(robot, known.speed, (known.radius_left, known.radius_right))


def _comment(target: str, robot: ExportedRobot, slip: str) -> str:
    known = calibrated(robot)
    carried = "\n".join(what_is_carried(target, robot)).replace("--", "- -")
    radius = f"{known.radius:.6g} m"
    if known.radius_left != known.radius_right:
        radius = f"{known.radius_left:.6g} m on the left and {known.radius_right:.6g} m on the right"
    return f"""\
<!--
Robot {robot.robot_id} of Calibrated Mixed Reality, as it was calibrated: written by cmr-export.
In Gazebo the robot turns as its wheels roll: place them {known.separation:.6g} m apart, one on each side, with a radius
of {radius}, and let casters slide.
Names of joints and links are to be those of your model.
DiffDrive counts with what the real robot's controller counts with.
{OF_SLIP.format(where=OF_FRICTION[target]) if slip else ""}
{carried}
-->"""


def _diff_drive(robot: ExportedRobot, said: Described) -> str:
    known = calibrated(robot)
    most = {
        "linear_velocity": known.speed,
        "angular_velocity": known.turn_rate,
        "linear_acceleration": known.acceleration,
        "angular_acceleration": known.turn_acceleration,
    }
    limits = "\n".join(
        f"  <max_{what}>{value:.6g}</max_{what}>\n  <min_{what}>{-value:.6g}</min_{what}>"
        for what, value in most.items()
        if value < inf
    )
    return f"""\
<plugin filename="gz-sim-diff-drive-system" name="gz::sim::systems::DiffDrive">
  <left_joint>left_wheel_joint</left_joint>
  <right_joint>right_wheel_joint</right_joint>
  <wheel_separation>{said.separation:.6g}</wheel_separation>
  <wheel_radius>{said.radius:.6g}</wheel_radius>
{limits}
</plugin>"""
