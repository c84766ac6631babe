"""The help of cmr-run, cmr-sim and cmr-sweep is for people who do not know Python."""

import re

import pytest

from cmr.commands import run, sim, sweep
from cmr.team.metrics import UNITS

COMMANDS = {"cmr-run": run, "cmr-sim": sim, "cmr-sweep": sweep}


def help_of(name: str, capsys: pytest.CaptureFixture[str]) -> str:
    with pytest.raises(SystemExit):
        COMMANDS[name]._options(["--help"])
    return " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize("name", COMMANDS)
def test_no_default_is_told_as_python_writes_it(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    found = re.findall(r"default: ([^)]*\)?)", help_of(name, capsys))
    assert not [value for value in found if re.match(r"[(\[{<]|None|True|False|PosixPath", value)]


def test_the_help_of_cmr_run_names_every_metric_that_can_end_a_run(capsys: pytest.CaptureFixture[str]) -> None:
    text = help_of("cmr-run", capsys)
    assert all(f"{name} [{unit}]" in text for name, unit in UNITS.items())
