"""The help of cmr-run, cmr-sim and cmr-sweep is for people who do not know Python."""

import re
from importlib import import_module

import pytest

from cmr.team.metrics import UNITS

pytestmark = pytest.mark.waits

COMMANDS = ("run", "sim", "sweep")


def help_of(name: str, capsys: pytest.CaptureFixture[str]) -> str:
    with pytest.raises(SystemExit):
        import_module(f"cmr.commands.{name}").main(["--help"])
    return " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize("name", COMMANDS)
def test_no_default_is_told_as_python_writes_it(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    found = re.findall(r"default: ([^)]*\)?)", help_of(name, capsys))
    assert not [value for value in found if re.match(r"[(\[{<]|None|True|False|PosixPath", value)]


def test_the_help_of_cmr_run_names_every_metric_that_can_end_a_run(capsys: pytest.CaptureFixture[str]) -> None:
    text = help_of("run", capsys)
    assert all(f"{name} [{unit}]" in text for name, unit in UNITS.items())
