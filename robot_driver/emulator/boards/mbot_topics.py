"""The topics of an emulated MBot control board, by number: those it receives, and those it sends.

Layouts as for `struct`, low bytes first. Sources: mbot-project/mbot_firmware, src/mbot_channels.h and
src/mbot_comms.c; mbot_lcm_base, mbot_msgs.
"""

from typing import NamedTuple

TIMESYNC, ODOMETRY_RESET, VEL_CMD = 201, 211, 214
ENCODERS_RESET, MOTOR_PWM_CMD, MOTOR_VEL_CMD = 222, 230, 231
ODOMETRY, IMU, ENCODERS, ANALOG_IN, MOTOR_VEL, MOTOR_PWM, VEL = 210, 220, 221, 223, 232, 233, 234


class Topic(NamedTuple):
    """A topic: its name in the firmware, its content, and its layout."""

    name: str
    what: str
    layout: str


TAKEN = {
    TIMESYNC: Topic("TIMESYNC", "time since 1970, µs", "<q"),
    ODOMETRY_RESET: Topic("ODOMETRY_RESET", "time; x, y (m), heading (rad) to go on from", "<q3f"),
    VEL_CMD: Topic("VEL_CMD", "time; velocity forwards, sideways (m/s), rate of turn (rad/s)", "<q3f"),
    ENCODERS_RESET: Topic("ENCODERS_RESET", "time; counts to go on from, three more and a time, unused", "<q3q3ii"),
    MOTOR_PWM_CMD: Topic("MOTOR_PWM_CMD", "time; duties, -1 to 1", "<q3f"),
    MOTOR_VEL_CMD: Topic("MOTOR_VEL_CMD", "time; speeds of the wheels (rad/s)", "<q3f"),
}
SAID = {
    ODOMETRY: Topic("ODOMETRY", "time; x, y (m), heading (rad), by the wheels", "<q3f"),
    IMU: Topic("IMU", "time; rates, accelerations, magnetic field, angles, attitude, temperature", "<q17f"),
    ENCODERS: Topic("ENCODERS", "time; counts; counts and µs since the turn before", "<q3q3ii"),
    ANALOG_IN: Topic("ANALOG_IN", "time; inputs; their voltages, the battery's last", "<q4h4f"),
    MOTOR_VEL: Topic("MOTOR_VEL", "time; speeds of the wheels (rad/s)", "<q3f"),
    MOTOR_PWM: Topic("MOTOR_PWM", "time; duties in force", "<q3f"),
    VEL: Topic("VEL", "time; velocity forwards, sideways (m/s), rate of turn (rad/s)", "<q3f"),
}
