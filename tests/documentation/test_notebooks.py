"""The notebooks run from top to bottom, and hold no output."""

import json
from pathlib import Path
from typing import Any

import matplotlib as mpl
import pytest

from tests.support.lanes import further
from tests.support.project import PROJECT

pytestmark = pytest.mark.slow

NOTEBOOKS = sorted((PROJECT / "docs" / "notebooks").glob("*.ipynb"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where all of them run: the first makes the log that the others use."""
    return tmp_path_factory.mktemp("notebooks")


# Commands of the pages on calibration and diagnosis run in test_blocks.py.
@pytest.mark.parametrize("path", [*further(*NOTEBOOKS[:2]), *NOTEBOOKS[2:]], ids=[path.stem for path in NOTEBOOKS])
def test_a_notebook_runs_from_top_to_bottom(path: Path, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    mpl.use("Agg")
    names: dict[str, Any] = {}
    cells = [cell for cell in json.loads(path.read_text())["cells"] if cell["cell_type"] == "code"]
    for number, cell in enumerate(cells):
        assert not cell["outputs"]
        exec(compile("".join(cell["source"]), f"{path.name}[{number}]", "exec"), names)


def test_there_are_three() -> None:
    assert [path.stem for path in NOTEBOOKS] == ["calibrate", "diagnose", "effect_of_your_own"]
