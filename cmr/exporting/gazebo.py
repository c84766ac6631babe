"""`cmr-export --to sdf|urdf`: the systems of Gazebo that drive a robot as calibrated: DiffDrive, and WheelSlip."""

from math import inf

from cmr.exporting.carried import SDF, URDF, what_is_carried
from cmr.exporting.diff_drive import Described, calibrated
from cmr.exporting.robot import ExportedRobot
from cmr.exporting.wheel_slip import SIDES, slips, wheel_slip

OF_SLIP = """\
WheelSlip needs wheels with one <collision> each, and the centre of mass over the axle. The first direction of
friction is to be along the axle: 0 0 1 if the wheel's cylinder is along z. {where}
Gazebo classic has the same system with filename="libWheelSlipPlugin.so" name="wheel_slip".
"""
OF_FRICTION = {
    SDF: "Put into each of these <collision>\n<surface><friction><ode><fdir1>0 0 1</fdir1></ode></friction></surface>.",
    URDF: "It is fdir1 below.",
}


def sdf(robot: ExportedRobot, said: Described) -> str:
    """Return the systems of Gazebo that drive the robot, to be pasted into its <model>.

    Raises ValueError where its wheels slip and its mass is not known.
    """
    return f"{_comment(SDF, robot)}\n{_plugins(robot, said)}\n"


def urdf(robot: ExportedRobot, said: Described) -> str:
    """Return what a URDF needs, to be pasted into its <robot>: xacro properties, and the systems of Gazebo.

    Raises ValueError where its wheels slip and its mass is not known.
    """
    known = calibrated(robot)
    plugins = "\n".join("  " + line for line in _plugins(robot, said).splitlines())
    return f"""\
{_comment(URDF, robot)}
<xacro:property name="wheel_separation" value="{known.separation:.6g}"/>
<xacro:property name="left_wheel_radius" value="{known.radius_left:.6g}"/>
<xacro:property name="right_wheel_radius" value="{known.radius_right:.6g}"/>
<gazebo>
{plugins}
</gazebo>
{_surfaces(robot)}"""


def _surfaces(robot: ExportedRobot) -> str:
    """Return what a URDF says of the wheels' surface, so that they slip along the axle and across it."""
    if not slips(robot):
        return ""
    return "".join(f'<gazebo reference="{side}_wheel_link">\n  <fdir1>0 0 1</fdir1>\n</gazebo>\n' for side in SIDES)


def _comment(target: str, robot: ExportedRobot) -> str:
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
{OF_SLIP.format(where=OF_FRICTION[target]) if slips(robot) else ""}
{carried}
-->"""


def _plugins(robot: ExportedRobot, said: Described) -> str:
    if not slips(robot):
        return _diff_drive(robot, said)
    known = calibrated(robot)
    slip = wheel_slip(robot, known.speed, (known.radius_left, known.radius_right), said.mass)
    return f"{_diff_drive(robot, said)}\n{slip}"


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
