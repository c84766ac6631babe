"""The scenarios that come with CMR, known by their names."""

from importlib.resources import files
from pathlib import Path

from cmr.experiments.scenario.plan import ScenarioError

SHIPPED = Path(str(files("cmr.experiments.scenario"))) / "shipped"


def shipped() -> dict[str, Path]:
    """Return the files of the shipped scenarios by name."""
    return {path.stem: path for path in sorted(SHIPPED.glob("*.yaml"))}


def path_of(name: str) -> Path:
    """Return the file of this path, or of the shipped scenario of this name.

    Raises ScenarioError where there is neither.
    """
    path = Path(name)
    if name in shipped() and not path.is_file():  # a folder of results may have the scenario's name
        return shipped()[name]
    if path.exists():
        return path
    raise ScenarioError(f"There is neither a file nor a shipped scenario {name!r}. Shipped: {', '.join(shipped())}.")
