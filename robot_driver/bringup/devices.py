"""Identify the devices at the ports by requests; nothing moves."""

from collections.abc import Sequence

from robot_driver.bringup.bench import CannotTell
from robot_driver.bringup.known import Plain
from robot_driver.controllers import CONTROLLERS
from robot_driver.guided import Choice, Guide
from robot_driver.host import Host
from robot_driver.listing import Found, devices_at
from robot_driver.serial_port import PortLost

At = tuple[str, Found]  # a port, and the device there


def find_devices(guide: Guide, host: Host, ports: Sequence[str]) -> dict[str, Plain]:
    """Return the driver's settings for the devices that answer at these ports. Raises CannotTell."""
    if not ports:
        raise CannotTell("there are no serial ports. Plug the devices in")
    found: list[At] = []
    problems = []
    for number, port in enumerate(ports):
        guide.progress(number / len(ports), f"asking {port}")
        try:
            found += [(port, one) for one in devices_at(port, host=host)]
        except PortLost as lost:
            problems.append(str(lost))
    lines = [f"{port}: {one}" for port, one in found] + problems
    guide.say("devices.answers", "\n".join(lines) or "Nothing answers at any port.")
    controller = _chosen(guide, "controller", "motor controller", [at for at in found if not at[1].is_gyro])
    if controller is None:
        raise CannotTell(
            "no motor controller answers. Check its power, its cable, and that it is set to packet serial or to "
            f"commands by RS-232 or USB. Asked: {', '.join(ports)}"
        )
    port, kind = controller
    gyro = _chosen(guide, "gyro", "gyro", [at for at in found if at[1].is_gyro])
    on_board = gyro is None and CONTROLLERS[kind.name].gyro is not None
    return {
        "port": port,
        "controller": kind.name,
        "baud": kind.other_baud,
        "gyro_port": gyro[0] if gyro else None,
        "gyro": gyro[1].name if gyro else "board" if on_board else None,
        "gyro_baud": gyro[1].other_baud if gyro else None,
    }


def _chosen(guide: Guide, name: str, words: str, found: Sequence[At]) -> At | None:
    """Return the only device, or the one chosen by the person; None without any."""
    if len(found) < 2:
        return found[0] if found else None
    choices = tuple(Choice(str(number), f"{port}: {one}") for number, (port, one) in enumerate(found, 1))
    key = guide.ask(f"devices.{name}", f"Several {words}s answer. Which one is that of this robot?", choices)
    return found[int(key) - 1]
