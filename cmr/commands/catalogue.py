"""The commands of `cmr`, each with its module and what it is for. Imports nothing, because it is read at every
start.
"""

# name: (module with `main` and `command_parser`, purpose)
COMMANDS = {
    "init": ("cmr.commands.init", "write what a new robot needs: parameters, udev rule, systemd units, scenario"),
    "doctor": ("cmr.commands.doctor", "check this computer: bus, ports, clock, priority, CPU; with remedies"),
    "demo": ("cmr.commands.demo", "drive, calibrate and drive again, without hardware"),
    "run": ("cmr.commands.run", "run a team experiment from a scenario to its report"),
    "agent": ("cmr.commands.agent", "run processes of experiments that another computer leads"),
    "bringup": ("robot_driver.bringup.command", "bring up a new robot: find devices, wiring, encoders, gyro and poses"),
    "driver": ("robot_driver.main", "connect a real robot to the bus"),
    "accept": (
        "robot_driver.acceptance.command",
        "prove the driver's promises on your own hardware, with a report",
    ),
    "emulate": ("cmr.commands.emulate", "emulate a robot: devices on pseudo-terminals, physics behind them"),
    "sim": ("cmr.commands.sim", "simulate virtual robots and twins in one world with the real ones"),
    "pilot": ("cmr.commands.pilot", "drive a real robot by a behaviour"),
    "teleop": ("cmr.commands.by_hand.teleop", "drive a robot by hand: keyboard, gamepad, or the joystick of a page"),
    "estop": ("cmr.commands.estop", "engage the emergency stop, release it, or show which robots it holds"),
    "key": ("cmr.commands.key", "make the key that signs messages, or show whether this computer has it"),
    "relay": ("cmr.commands.relay", "sign messages of programs that have no key, such as a motion capture system's"),
    "camera": ("cmr.commands.camera", "measure poses of real robots with a camera"),
    "tracker": ("cmr.tracker.command", "publish poses of real robots from a motion capture system"),
    "ros2": ("robot_driver.ros2.command", "have ROS 2 robots take part as real ones, and show virtual ones to ROS 2"),
    "view": ("cmr.commands.view", "show the world in a web page, live or from a log"),
    "calibrate": ("cmr.commands.calibrate", "find the parameters of a robot, live or from a log"),
    "diagnose": ("cmr.commands.diagnose", "name what the simulation of a robot gets wrong"),
    "laws": ("cmr.diagnosis.collection_command", "list and compare the laws found on robots, keep them as entries"),
    "investigate": (
        "cmr.commands.investigating.command",
        "let a robot find out by itself what its simulation gets wrong",
    ),
    "export": ("cmr.exporting.command", "take a calibrated robot to another simulator or robot description"),
    "fidelity": ("cmr.commands.fidelity", "compare teams of real robots with mixed ones"),
    "sweep": ("cmr.commands.sweep", "run a scenario many times, without hardware"),
    "import": ("cmr_tools.importing.import_log", "turn recordings of other robots into event logs"),
    "log": ("cmr_tools.logs.main", "check, cut, merge and convert event logs"),
    "plot": ("cmr_tools.plot.main", "plot fields of an event log over time"),
    "replay": ("cmr_tools.replay.main", "send the messages of an event log again"),
    "spy": ("cmr_tools.spy.main", "show what is on the bus"),
    "completion": ("cmr.commands.completion", "print the completion of bash, zsh or fish"),
}
UMBRELLA_ONLY = (
    "accept",
    "init",
    "doctor",
    "bringup",
    "estop",
    "key",
    "relay",
    "completion",
)  # each of the others is also a command of its own: cmr-sim


def name_of(name: str) -> str:
    """Return a command's displayed name: its own executable, otherwise under the umbrella."""
    return f"cmr {name}" if name in UMBRELLA_ONLY else f"cmr-{name}"
