"""cmr key: make the key of the bus, or show whether this computer has it."""

import argparse

from cmr.bus.keys import read_key, shown, write_new_key
from cmr.cli import configuration
from cmr.cli.command_line import parser
from cmr.cli.errors import CommandError

SHOW, NEW = "show", "new"
HOW_TO_COPY = "Copy it to each computer on the bus, for example: scp -p {path} robot:.config/cmr/key"


def main(arguments: list[str]) -> int:
    """Run cmr key.

    Raises CommandError where there is no key, KeyFileError when it cannot be read or written.
    """
    options = command_parser().parse_args(arguments)
    path, is_named = configuration.key_file()
    if options.action == NEW:
        key = write_new_key(path, options.replace)
        print(f"{path}: a new key, {shown(key)}. {HOW_TO_COPY.format(path=path)}")
        return 0
    if not is_named and not path.exists():
        raise CommandError(f"{path}: there is no key; messages are not signed. Make one with: cmr key new")
    print(f"{path}: {shown(read_key(path))}")
    return 0


def command_parser() -> argparse.ArgumentParser:
    """Return the command line of cmr key."""
    result = parser(
        "cmr key",
        "Make the key of the bus, or show whether this computer has it. With a key, processes sign what they send, "
        "and accept only messages signed with it, except emergency stops. Every computer on the bus needs the same "
        "key. The fingerprint shown is not secret: two computers that show the same one have the same key.\n\nThe "
        "file of the key is CMR_KEY of the environment, otherwise key of ~/.config/cmr/config.yaml, otherwise "
        "~/.config/cmr/key. Nobody but its owner may read it.",
        "cmr key\n  cmr key new",
    )
    result.add_argument("action", nargs="?", choices=(SHOW, NEW), default=SHOW, help=f"what to do (default: {SHOW})")
    result.add_argument("--replace", action="store_true", help="replace an existing key")
    return result
