"""Where in the code a process subscribes to messages: all such calls, whichever process makes them."""

import ast
from collections.abc import Iterator
from pathlib import Path

# The bus itself and its test; a bus in simulated time.
NOT_OF_A_PROCESS = ("cmr/bus/", "robot_driver/simulated/", "cmr/msg/", "cmr/tools/")  # the last is a link to tools/
# What goes on only with a person who answers questions beside the robot is not fuzzed.
WITH_A_PERSON = ("robot_driver/bringup/", "robot_driver/acceptance/")
# A second subscription of cmr-run to PROCESS_STATUS, where a scenario names other computers.
NOT_MADE = frozenset({"cmr/commands/run.py"})


def in_the_code(root: Path) -> Iterator[tuple[str, int]]:
    """Yield file and line of each call of `subscribe` by a process."""
    for folder in ("cmr", "robot_driver", "tools"):
        for path in sorted((root / folder).rglob("*.py")):
            name = str(path.relative_to(root))
            if name.startswith((*NOT_OF_A_PROCESS, *WITH_A_PERSON)):
                continue
            for node in ast.walk(ast.parse(path.read_text())):
                if (
                    isinstance(node, ast.Call)
                    and isinstance(node.func, ast.Attribute)
                    and node.func.attr == "subscribe"
                ):
                    yield name, node.lineno


def not_made(root: Path, made: set[tuple[str, int]]) -> list[str]:
    """Return the calls that no process made when all were started, as file:line."""
    return [f"{name}:{line}" for name, line in in_the_code(root) if (name, line) not in made and name not in NOT_MADE]
