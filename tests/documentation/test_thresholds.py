"""The page of thresholds says what the search has."""

import sys

from tests.support.project import PROJECT

sys.path.insert(0, str(PROJECT / "scripts"))
from documentation.thresholds import ESTIMATION, PAGE, SOURCES, STAGES, UNITS, document, thresholds


def test_the_page_is_that_of_the_modules() -> None:
    assert PAGE.read_text(encoding="utf-8") == document(), "run scripts/write_thresholds"


def test_every_module_of_the_estimation_with_numbers_has_a_stage() -> None:
    there = {path.relative_to(ESTIMATION).with_suffix("").as_posix() for path in ESTIMATION.rglob("*.py")}
    listed = [module for modules in STAGES.values() for module in modules]
    assert sorted(listed) == sorted(module for module in there if any(thresholds(module)))


def test_every_threshold_says_what_it_is() -> None:
    every = [(module, one) for modules in STAGES.values() for module in modules for one in thresholds(module)]
    assert not [f"{module}: {one.names}" for module, one in every if not one.meaning]
    assert len(every) > 90


def test_units_and_sources_are_those_of_thresholds_that_exist() -> None:
    modules = [module for of_stage in STAGES.values() for module in of_stage]
    every = {(module.split("/")[-1], one.names) for module in modules for one in thresholds(module)}
    known = {name for _, name in every} | {f"{module}.{name}" for module, name in every}
    assert not {*UNITS, *SOURCES} - known
