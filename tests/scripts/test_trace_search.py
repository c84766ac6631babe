"""From a log to the named effect, a reader follows few functions of the search."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.hidden_effects import hide
from tests.support.project import PROJECT

MOST = 25  # functions of control, for one hidden effect

pytestmark = pytest.mark.slow


def test_control_passes_through_few_functions_from_a_log_to_its_named_effect(tmp_path: Path) -> None:
    log = tmp_path / "run.lcm"
    hide("coulomb_friction", manoeuvre="rich", seed=3, path=log)
    command = [sys.executable, str(PROJECT / "scripts" / "trace_search"), str(log)]
    lines = subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines()
    control = [line.split()[-1] for line in lines if line.startswith("control")]
    # In the order of the stages.
    stages = ["estimate", "search_effects", "search", "screen", "ranked_fits", "finished", "that_holds"]
    assert [name for name in control if name in stages] == stages
    assert len(control) <= MOST
