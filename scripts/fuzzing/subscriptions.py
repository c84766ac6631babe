"""Find all calls in the code that subscribe to messages."""

import ast
from collections.abc import Iterator
from pathlib import Path

# The bus itself, the bus in simulated time, and generated code.
EXCLUDED = ("cmr/bus/", "robot_driver/simulated/", "cmr/msg/")
# Procedures that need a person who answers questions beside the robot are not fuzzed.
INTERACTIVE = ("robot_driver/bringup/", "robot_driver/acceptance/")
# cmr-run subscribes to PROCESS_STATUS a second time if a scenario names other computers.
EXEMPT = frozenset({"cmr/commands/run.py"})


def subscribe_calls(root: Path) -> Iterator[tuple[str, int]]:
    """Yield file and line of each call of `subscribe` in code of processes."""
    for folder in ("cmr", "robot_driver", "tools"):
        for path in sorted((root / folder).rglob("*.py")):
            name = str(path.relative_to(root))
            if name.startswith((*EXCLUDED, *INTERACTIVE)):
                continue
            for node in ast.walk(ast.parse(path.read_text())):
                if (
                    isinstance(node, ast.Call)
                    and isinstance(node.func, ast.Attribute)
                    and node.func.attr == "subscribe"
                ):
                    yield name, node.lineno


def missing_subscriptions(root: Path, observed: set[tuple[str, int]]) -> list[str]:
    """Return the calls of `subscribe` that are not among the observed ones, as file:line."""
    return [
        f"{name}:{line}" for name, line in subscribe_calls(root) if (name, line) not in observed and name not in EXEMPT
    ]
