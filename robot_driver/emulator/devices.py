"""The tables of devices that can be emulated, by their name in cmr-driver."""

from collections.abc import Callable

from robot_driver.emulator.device import Device
from robot_driver.emulator.dsp3000_device import Dsp3000Device
from robot_driver.emulator.kvh_binary_device import KvhBinaryDevice
from robot_driver.emulator.mbot_device import MBotDevice
from robot_driver.emulator.plant import Plant
from robot_driver.emulator.roboclaw_device import RoboclawDevice
from robot_driver.emulator.roboclaw_pair_device import RoboclawPairDevice
from robot_driver.emulator.roboteq_device import RoboteqDevice
from robot_driver.emulator.settings import Settings

CONTROLLER_DEVICES: dict[str, Callable[[Settings, Plant], Device]] = {
    "mbot": MBotDevice,
    "roboclaw": RoboclawDevice,
    "roboclaw-pair": RoboclawPairDevice,
    "roboteq": RoboteqDevice,
}
GYRO_DEVICES: dict[str, Callable[[Settings, Plant], Device]] = {
    "dsp3000": Dsp3000Device,
    "kvh-binary": KvhBinaryDevice,
}
