"""What an effect touches is counted by kind."""

import runpy

import pytest

from cmr.model.catalogue import CATALOGUE
from tests.support.project import PROJECT

pytestmark = pytest.mark.skipif(not (PROJECT / ".git").exists(), reason="this is not a git clone")
SCRIPT = runpy.run_path(str(PROJECT / "scripts" / "count_effect_files"))


def test_an_effect_is_named_by_its_entry_the_plant_and_tests() -> None:
    files = SCRIPT["files_by_kind"]("pose_smoothing")
    assert files["entry"] == ["cmr/model/effects/sensors.py"]
    assert "cmr/plant/sensors.py" in files["independent plant"]
    assert "tests/model/test_effects.py" in files["tests"]
    assert files["generated"] == ["docs/effects.md"]


def test_an_effect_shows_nowhere_else() -> None:
    assert SCRIPT["files_by_kind"]("pose_smoothing")["elsewhere"] == []


def test_the_last_effect_shipped_is_one_of_the_catalogue() -> None:
    assert SCRIPT["last_effect"]() in CATALOGUE


def test_an_unknown_effect_is_refused() -> None:
    with pytest.raises(KeyError):
        SCRIPT["files_by_kind"]("side_wind")
