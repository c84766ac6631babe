"""What is compiled is kept for later processes, and compiled once only."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytestmark = pytest.mark.slow

# Any small compiled function will do.
COMPILE = """
import sys
import numpy as np
from cmr.estimation.problem import temper
white = np.array([1.0, 9.0])
sys.stdin.readline()
temper(white, 4.0)
print(sum(temper._dispatcher.stats.cache_misses.values()), white[1])
"""


def test_processes_that_begin_together_compile_only_once(tmp_path: Path) -> None:
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path)}
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", COMPILE],
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        for _ in range(3)
    ]
    for process in processes:
        assert process.stdin is not None
        process.stdin.write("\n")
        process.stdin.flush()
    said = [process.communicate(timeout=120)[0].split() for process in processes]
    assert [process.returncode for process in processes] == [0, 0, 0]
    assert sum(int(compiled) for compiled, _ in said) == 1
    np.testing.assert_allclose([float(value) for _, value in said], np.sqrt(2.0 * 4.0 * 9.0 - 4.0**2))
