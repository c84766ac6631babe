"""cmr-emulate: the emulated robot of `robot_driver.emulator`, compiled at its first use before it starts."""

from cmr.commands.first_use import EMULATOR, compile_first
from robot_driver.emulator import main as emulator
from robot_driver.emulator.main import command_parser as command_parser


def main(arguments: list[str]) -> int:
    """Run cmr-emulate."""
    command_parser().parse_args(arguments)  # --help, or a usage error, ends here
    compile_first([EMULATOR])
    return emulator.main(arguments)
