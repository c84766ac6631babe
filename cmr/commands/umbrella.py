"""cmr: one command for everything. `cmr sim ...` is `cmr-sim ...`."""

import sys
from difflib import get_close_matches

from cmr.commands.catalogue import COMMANDS, name_of
from cmr.distribution import DRIVER_NAME, NAME, has_module

USAGE = "usage: cmr [-h] [--version] COMMAND ..."


def main(arguments: list[str]) -> int:
    """Run the command named first, in this process; it does not return."""
    name, *rest = arguments or ["--help"]
    if name in ("-h", "--help", "help"):
        print(_help())
        return 0
    if name == "--version":
        from cmr.distribution import version

        print(f"cmr {version()}")
        return 0
    if name not in COMMANDS:
        near = get_close_matches(name, COMMANDS)
        hint = f"Did you mean {' or '.join(near)}?" if near else "cmr --help lists all commands."
        print(f"{USAGE}\ncmr: error: there is no command {name!r}. {hint}", file=sys.stderr)
        return 2
    module, _purpose = COMMANDS[name]
    if not has_module(module):
        print(f"cmr: error: {DRIVER_NAME} is installed, which has no {name}. {NAME} has it.", file=sys.stderr)
        return 2
    from cmr.cli.start import run

    sys.argv = [name_of(name), *rest]
    return run(module)


def _help() -> str:
    from cmr.cli.command_line import EXIT_CODES

    width = max(map(len, COMMANDS))
    here = {name: purpose for name, (module, purpose) in COMMANDS.items() if has_module(module)}
    commands = "\n".join(f"  {name:{width}}  {purpose}" for name, purpose in here.items())
    return (
        f"{USAGE}\n\nCalibrated Mixed Reality: real and virtual robots in one world.\n\ncommands:\n{commands}\n\n"
        "cmr COMMAND --help explains a command. Most can be called by a name of their own, too: cmr-sim.\n\n"
        "options:\n  -h, --help  show this help message and exit\n"
        "  --version   show program's version number and exit\n\n"
        f"example:\n  cmr {'demo' if 'demo' in here else 'doctor'}\n\n{EXIT_CODES}"
    )
