"""Generate the Python message classes and their stubs from lcmtypes/ whenever the package is built.

The build (pip install, pip install -e, pip wheel) calls this through pyproject.toml. It runs
the lcm-gen of the `lcm` wheel, which is a build requirement. The result, `cmr/msg/`, is not in git.
lcm-gen writes no annotations, so a stub beside each class declares the types of the fields.
"""

import runpy
import subprocess
from collections.abc import Iterator
from pathlib import Path

from setuptools.command.build_py import build_py

PROJECT = Path(__file__).resolve().parent.parent
SINGLE = {
    **dict.fromkeys(("int8_t", "int16_t", "int32_t", "int64_t", "byte"), "int"),
    **{"double": "float", "float": "float", "boolean": "bool", "string": "str"},
}
# Messages hold sequences, except those that are decoded faster into arrays.
ARRAYS = {"float": "Sequence[float] | NDArray[float64]", "int": "Sequence[int] | NDArray[int64]"}
STUB_HEAD = '''"""Types of {name}; generated from lcmtypes/ by scripts/build_messages.py."""

from collections.abc import Sequence
from typing import ClassVar

from numpy import float64, int64
from numpy.typing import NDArray

class {name}:
    """{summary}"""

    __slots__: ClassVar[list[str]]
    __typenames__: ClassVar[list[str]]
    __dimensions__: ClassVar[list[list[str | int] | None]]
'''
STUB_TAIL = """    def __init__(self) -> None: ...
    def encode(self) -> bytes: ...
    @staticmethod
    def decode(data: bytes) -> {name}: ...
    @staticmethod
    def _get_packed_fingerprint() -> bytes: ...
    def get_hash(self) -> int: ...
"""


def lcm_gen() -> Path:
    """Return the path of lcm-gen.

    Raises SystemExit, which ends the build with only its message, if LCM lacks a library of the system.
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
    package = destination / "cmr" / "msg"
    write_stubs(package)
    # The build must not import a package of the project: another version of CMR may be installed, or none.
    distribution = runpy.run_path(str(PROJECT / "cmr" / "distribution.py"))
    fingerprint = distribution["fingerprint"](PROJECT / "lcmtypes")
    (package / distribution["FINGERPRINT"]).write_text(fingerprint, encoding="ascii")


def write_stubs(package: Path) -> None:
    """Write a stub (`.pyi`) beside each generated class of a package."""
    for source in sorted(package.glob("*_t.py")):
        message_type = runpy.run_path(str(source))[source.stem]
        source.with_suffix(".pyi").write_text("".join(f"{line}\n" for line in stub_of(message_type)))


def stub_of(message_type: type) -> Iterator[str]:
    """Yield the lines of the stub of a generated class: constants, fields with their types, methods."""
    name = message_type.__name__
    summary = " ".join((message_type.__doc__ or name).split())
    yield from STUB_HEAD.format(name=name, summary=summary).splitlines()
    for constant, value in vars(message_type).items():
        if constant.isupper():
            yield f"    {constant}: ClassVar[{type(value).__name__}] = {value!r}"
    fields = zip(*(getattr(message_type, f"__{part}__") for part in ("slots", "typenames", "dimensions")), strict=True)
    for field, wire_type, dimensions in fields:
        yield f"    {field}: {field_type(wire_type, is_array=dimensions is not None)}"
    yield from STUB_TAIL.format(name=name).splitlines()


def field_type(wire_type: str, *, is_array: bool) -> str:
    """Return the annotation of a field.

    Raises KeyError for a type that no message has: messages in messages, arrays of strings.
    """
    single = SINGLE[wire_type]
    if not is_array:
        return single
    return "bytes" if wire_type == "byte" else ARRAYS[single]


class BuildWithMessages(build_py):
    """The usual build of Python modules, and the message classes with it."""

    def run(self) -> None:
        """Build the modules, then generate `cmr/msg` where the package will be imported from."""
        super().run()
        generate_messages(PROJECT if self.editable_mode else Path(self.build_lib))
