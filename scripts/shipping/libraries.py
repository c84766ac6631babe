"""The libraries in the Debian package: lcm, pyserial and PyYAML, for each Python version of an architecture."""

import struct
import subprocess
import zipfile
from pathlib import Path

PYTHONS = ("3.10", "3.11", "3.12", "3.13", "3.14")
PROCESSORS = {"amd64": "x86_64", "arm64": "aarch64"}  # Debian's names, Linux's names
PLATFORMS = ("manylinux_2_28", "manylinux2014")
PINNED = Path(__file__).with_name("libraries.txt")
MODULES = ("lcm/", "serial/", "yaml/")
EXTENSION = ".so"
ELF_HEADER = struct.Struct("<4s14xH12xQQ6xHHHHH")  # magic, machine, offsets of both tables, their sizes and counts
SEGMENT = struct.Struct("<8xQ16xQ")  # offset and length of a segment in the file


def download_wheels(
    pip: list[str], architecture: str, folder: Path, pythons: tuple[str, ...] = PYTHONS
) -> dict[str, list[Path]]:
    """Download the pinned wheels of an architecture from the package index; return them for each Python version.

    Raises SystemExit with pip's messages if a wheel cannot be downloaded or has another hash.
    """
    found = {}
    for python in pythons:
        target = folder / architecture / python
        command = [*pip, "download", "--quiet", "--no-deps", "--only-binary", ":all:", "--implementation", "cp"]
        command += ["--require-hashes", "--requirement", str(PINNED), "--python-version", python]
        command += ["--dest", str(target)]
        for platform in PLATFORMS:
            command += ["--platform", f"{platform}_{PROCESSORS[architecture]}"]
        result = subprocess.run(command, capture_output=True, text=True, check=False)
        if result.returncode:
            raise SystemExit(f"{' '.join(command)} failed:\n{result.stdout}{result.stderr}")
        found[python] = sorted(target.glob("*.whl"))
    return found


def files_of(wheels: dict[str, list[Path]], architecture: str) -> dict[str, bytes]:
    """Return the modules and licences of the libraries for all Python versions, by path in one import root.

    The name of a compiled module contains the Python version, so that each version loads its own.
    """
    files = {}
    for python, paths in wheels.items():
        for path in paths:
            with zipfile.ZipFile(path) as wheel:
                for name in wheel.namelist():
                    if _is_needed(name):
                        content = wheel.read(name)
                        is_compiled = name.endswith(EXTENSION)
                        files[_name_for(python, architecture, name)] = (
                            strip_unloaded(content) if is_compiled else content
                        )
    return files


def strip_unloaded(library: bytes) -> bytes:
    """Return a shared library without the parts that are not loaded, such as debug information (most of PyYAML)."""
    magic, _machine, segments, _sections, size, count, *_ = ELF_HEADER.unpack_from(library)
    if magic != b"\x7fELF":
        raise ValueError("not an ELF file")
    places = [SEGMENT.unpack_from(library, segments + number * size) for number in range(count)]
    return without_section_table(library[: max(start + length for start, length in places)])


def without_section_table(library: bytes) -> bytes:
    """Return a 64-bit ELF file whose header states that it has no section table."""
    return library[:0x28] + bytes(8) + library[0x30:0x3C] + bytes(4) + library[0x40:]


def machine_of(library: bytes) -> int:
    """Return the machine number of an ELF file, as in elf.h: 62 is x86-64, 183 is 64-bit ARM."""
    return int(ELF_HEADER.unpack_from(library)[1])


def _is_needed(name: str) -> bool:
    if ".dist-info/" in name:
        return name.endswith("/METADATA") or ("/licenses/" in name and not name.endswith("/"))
    return name.startswith(MODULES) and name.endswith((".py", EXTENSION))


def _name_for(python: str, architecture: str, name: str) -> str:
    if not name.endswith(EXTENSION) or ".cpython-" in name:
        return name
    tag = f"cpython-{python.replace('.', '')}-{PROCESSORS[architecture]}-linux-gnu"
    return f"{name.removesuffix(EXTENSION)}.{tag}{EXTENSION}"
