"""Generate the Python message classes from lcmtypes/ whenever the package is built.

The build (pip install, pip install -e, pip wheel) calls this through pyproject.toml. It runs
the lcm-gen of the `lcm` wheel, which is a build requirement. The result, `cmr/msg/`, is not in git.
"""

import subprocess
from pathlib import Path

from setuptools.command.build_py import build_py

PROJECT = Path(__file__).resolve().parent.parent


def lcm_gen() -> Path:
    """Return the path of lcm-gen.

    Raises SystemExit, which ends the build with its sentence alone, when LCM lacks a library of the system.
    """
    try:
        import lcm
    except ImportError as error:
        if "libglib-2.0.so.0" not in str(error):
            raise
        raise SystemExit(
            "LCM needs the system's library libglib-2.0.so.0: sudo apt-get install libglib2.0-0, then build again."
        ) from None
    # The wheel's console script is a wrapper; this is the program itself.
    return Path(lcm.LCM_BIN_DIR) / "lcm-gen"


def generate_messages(destination: Path) -> None:
    """Write the package `cmr/msg/` below `destination`, an import root.

    Raises RuntimeError when lcm-gen cannot run or rejects a type.
    """
    types = sorted(str(path) for path in (PROJECT / "lcmtypes").glob("*.lcm"))
    result = subprocess.run(
        [str(lcm_gen()), "--python", "--ppath", str(destination), *types], capture_output=True, text=True, check=False
    )
    if result.returncode != 0:
        raise RuntimeError(f"lcm-gen could not generate cmr/msg from lcmtypes/: {result.stderr or result.stdout}")


class BuildWithMessages(build_py):
    """The usual build of Python modules, and the message classes with it."""

    def run(self) -> None:
        """Build the modules, then generate `cmr/msg` where the package will be imported from."""
        super().run()
        generate_messages(PROJECT if self.editable_mode else Path(self.build_lib))
