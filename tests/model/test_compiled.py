"""What is compiled is kept for later processes, and compiled once only."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from cmr.model.compiled import jit
from cmr.model.remembered_types import _MEMORY, remembered

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


# Operators of several types, a function that is inlined twice, and a sum whose type only the loop decides. What is
# printed: how often that function was analysed, and the instructions, without names, in which Numba counts.
INSTRUCTIONS = """
import re
import sys
from contextlib import nullcontext
import numba
from numba.core.inline_closurecall import InlineWorker
from cmr.model.remembered_types import remembered

analysed = []
analyse = InlineWorker.run_untyped_passes

def counted(worker, function, enable_ssa=False):
    analysed.append(function)
    return analyse(worker, function, enable_ssa)

InlineWorker.run_untyped_passes = counted

@numba.njit(inline="always", fastmath={"contract"})
def bent(x, limit):
    return x - limit if x > limit else x * x + limit

@numba.njit(fastmath={"contract"})
def total(values, counts):
    result = 0
    for i in range(len(values)):
        result += bent(values[i], 0.5) * counts[i] + bent(values[i] * 2.0, 1) // 3
    return result

with remembered() if sys.argv[1] == "remembered" else nullcontext():
    total.compile("f8(f8[::1], i8[::1])")
[code] = total.inspect_asm().values()
print(len(analysed))
print(re.sub(r"[\\w.$]*_ZN[\\w.$]*|[.]L\\w+", "name", code))
"""


def test_what_numba_remembers_changes_no_instruction() -> None:
    (often, plain), (once, quick) = (
        subprocess.run(
            [sys.executable, "-c", INSTRUCTIONS, how], capture_output=True, text=True, check=True
        ).stdout.split("\n", 1)
        for how in ("plain", "remembered")
    )
    assert (often, once) == ("2", "1")
    assert "mul" in plain
    assert quick == plain


def test_numba_forgets_when_all_is_compiled() -> None:
    with remembered():
        with remembered():
            jit(lambda x: x * 2.0).compile("f8(f8)")
        assert _MEMORY.types
    assert not _MEMORY.types
