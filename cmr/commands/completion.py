"""cmr completion: shell completion of commands and options, without starting Python at the Tab key."""

import argparse
from importlib import import_module
from pathlib import Path

from cmr.cli.command_line import parser
from cmr.commands.catalogue import COMMANDS, UMBRELLA_ONLY, name_of

SHELLS = ("bash", "zsh", "fish")
# `cmr-sim --<Tab>` is completed as `cmr sim --<Tab>`.
OWN_NAMES_BASH = """
_cmr_by_its_own_name() {
  COMP_WORDS=(cmr "${COMP_WORDS[0]##*cmr-}" "${COMP_WORDS[@]:1}")
  COMP_CWORD=$((COMP_CWORD + 1))
  _shtab_cmr
}
complete -o filenames -F _cmr_by_its_own_name NAMES
"""
OWN_NAMES_ZSH = """\
  if [[ $words[1] == *cmr-* ]]; then
    words=(cmr "${words[1]##*cmr-}" "${(@)words[2,-1]}")
    (( CURRENT += 1 ))
  fi
"""
EXAMPLE = """\
cmr completion bash > ~/.cmr-completion.bash   # and: source it in ~/.bashrc
  cmr completion zsh > ~/.zfunc/_cmr     # with fpath+=~/.zfunc before compinit
  cmr completion fish > ~/.config/fish/completions/cmr.fish"""


def main(arguments: list[str]) -> int:
    """Run cmr completion."""
    print(script(command_parser().parse_args(arguments).shell))
    return 0


def command_parser() -> argparse.ArgumentParser:
    """Return the command line of cmr completion."""
    options = parser(
        "cmr completion",
        "Print the completion of a shell: commands, options, choices and files, of cmr and of the commands with names "
        "of their own. Write it to where the shell looks for it, once after each installation.",
        EXAMPLE,
        bus="of no use here: nothing goes over a bus",
    )
    options.add_argument("shell", choices=SHELLS, help="which shell it is for")
    return options


def _is_file(action: argparse.Action) -> bool:
    return action.type is Path or action.metavar == "DEVICE" or not action.option_strings


def _complete_files(command: argparse.ArgumentParser, files: object) -> None:
    """Mark the options and arguments that are files, for shtab, including subcommands."""
    for action in command._actions:
        if isinstance(action.choices, dict):
            for subcommand in action.choices.values():
                _complete_files(subcommand, files)
        elif action.choices is None and _is_file(action):
            action.complete = files  # type: ignore[attr-defined] # shtab looks for it


def script(shell: str) -> str:
    """Return the completion of all commands for a shell."""
    import shtab  # generates completion for each shell from an argparse parser

    umbrella = argparse.ArgumentParser("cmr")
    commands = umbrella.add_subparsers()
    for name, (module, purpose) in COMMANDS.items():
        described = import_module(module).command_parser()
        command = commands.add_parser(name, help=purpose, parents=[described], add_help=False)
        _complete_files(command, shtab.FILE)
    names = [name_of(name) for name in COMMANDS if name not in UMBRELLA_ONLY]
    completed: str = shtab.complete(umbrella, shell)
    if shell == "bash":
        return completed + OWN_NAMES_BASH.replace("NAMES", " ".join(names))
    if shell == "fish":
        return completed + "\n".join(f"complete -c {name} -w 'cmr {name.removeprefix('cmr-')}'" for name in names)
    zsh = completed.replace("#compdef cmr\n", f"#compdef cmr {' '.join(names)}\n")
    return zsh.replace("_shtab_cmr() {\n", f"_shtab_cmr() {{\n{OWN_NAMES_ZSH}")
