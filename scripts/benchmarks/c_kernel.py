"""The reference for the step: paper_step.c, built with gcc if that is installed."""

import ctypes
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

from cmr.recordings.recording import Floats

SOURCE = Path(__file__).with_name("paper_step.c")
ARRAYS = 16


class NoCompilerError(Exception):
    """There is no gcc, or it fails; the text says which."""


def build() -> Callable[[Sequence[Floats]], Callable[[], object]]:
    """Build the kernel; return a function that binds arrays to it and returns the step: state, duties, coefficients.

    Raises NoCompilerError.
    """
    gcc = shutil.which("gcc")
    if gcc is None:
        raise NoCompilerError("there is no gcc on this machine")
    with tempfile.TemporaryDirectory() as folder:
        library = Path(folder) / "paper_step.so"
        built = subprocess.run(
            [gcc, "-O3", "-march=native", "-shared", "-fPIC", "-o", str(library), str(SOURCE)],
            capture_output=True,
            text=True,
            check=False,
        )
        if built.returncode:
            raise NoCompilerError(f"gcc failed: {built.stderr.strip()}")
        function = ctypes.CDLL(str(library)).step  # stays loaded after its file is deleted
    function.argtypes = [ctypes.c_long, *[ctypes.c_void_p] * ARRAYS]
    function.restype = None

    def bind(arrays: Sequence[Floats]) -> Callable[[], object]:
        arguments = (ctypes.c_long(len(arrays[0])), *(ctypes.c_void_p(array.ctypes.data) for array in arrays))
        return lambda: function(*arguments)

    return bind
