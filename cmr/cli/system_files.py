"""System files for a robot's computer: udev rules for its ports, systemd units for driver and agent.

`cmr init` writes rules and driver unit of one robot; scripts/release puts generic ones into the Debian package.
"""

USB_IDS = {"roboclaw": ("03eb", "2404"), "roboclaw-pair": ("03eb", "2404"), "roboteq": ("20d2", "5740")}
MARK = "put the ids here that `udevadm info -a` shows for the port"
SERIAL_PORTS = ("ttyUSB", "ttyACM", "ttyAMA", "ttyS")  # names in /proc/devices
# The driver reads its configuration, uses serial ports and the bus, and stores a stop in its StateDirectory=.
ALLOWED_TO_A_DRIVER = (
    "StateDirectory=cmr",
    "LimitRTPRIO=1",
    "LimitMEMLOCK=64M",
    "NoNewPrivileges=yes",
    "ProtectSystem=strict",
    "ProtectHome=read-only",
    "PrivateTmp=yes",
    "DevicePolicy=closed",
    *(f"DeviceAllow=char-{port} rw" for port in SERIAL_PORTS),
    "ProtectKernelTunables=yes",
    "ProtectKernelModules=yes",
    "ProtectControlGroups=yes",
    "RestrictAddressFamilies=AF_INET AF_INET6 AF_UNIX AF_NETLINK",
    "RestrictNamespaces=yes",
    "RestrictSUIDSGID=yes",
    "LockPersonality=yes",
    "SystemCallArchitectures=native",
)


def udev_rule(name: str, ids: tuple[str, str] | None) -> str:
    """Return the udev rule that names a USB device with these ids, vendor and product, /dev/`name`; a comment without
    ids.
    """
    vendor, product = ids or ("xxxx", "xxxx")
    comment = "" if ids else f"# {MARK}\n# "
    return (
        f'{comment}SUBSYSTEM=="tty", ATTRS{{idVendor}}=="{vendor}", ATTRS{{idProduct}}=="{product}", '
        f'SYMLINK+="{name}", ENV{{ID_MM_DEVICE_IGNORE}}="1", GROUP="dialout", MODE="0660"'
    )


def command_line(words: list[str]) -> str:
    """Return a command in the syntax of ExecStart=."""
    return " ".join(f'"{word}"' if " " in word else word for word in words).replace("%", "%%")


def unit(what: str, command: str, *more: str) -> str:
    """Return a unit of systemd that runs a command; `more` are lines of its section [Service]."""
    sections = {
        "Unit": [f"Description=CMR {what}", "After=network-online.target", "Wants=network-online.target"],
        "Service": [f"ExecStart={command}", *more, "Restart=on-failure", "RestartSec=2"],
        "Install": ["WantedBy=multi-user.target"],
    }
    return "\n".join("\n".join((f"[{section}]", *lines, "")) for section, lines in sections.items())


def driver_unit(robot: str, command: str, *more: str) -> str:
    """Return the unit of a robot's driver, restricted to what a driver needs."""
    return unit(f"driver of robot {robot}", command, *more, *ALLOWED_TO_A_DRIVER)


def agent_unit(command: str, *more: str) -> str:
    """Return the unit of the agent, restricted to what the drivers that it starts need."""
    return unit("agent of experiments", command, *more, *ALLOWED_TO_A_DRIVER)
