"""The last gate of a driver, as tests find it among the processes of this machine."""

from pathlib import Path


def gates_of(process: int) -> list[int]:
    """Return the processes of the gates that a driver has started."""
    found = []
    for task in Path(f"/proc/{process}/task").iterdir():
        found += [int(child) for child in (task / "children").read_text().split()]
    return found


def gate_of(process: int) -> int:
    """Return the process of the only gate that a driver has started."""
    (found,) = gates_of(process)
    return found


def is_gone(process: int) -> bool:
    """Return whether a process has ended; who inherits it may not have noticed yet."""
    try:
        return ") Z " in Path(f"/proc/{process}/stat").read_text()
    except FileNotFoundError:
        return True
