"""The libraries that the Debian package brings along: lcm, pyserial and PyYAML, for each Python of a processor."""

import struct
import subprocess
import zipfile
from pathlib import Path

PYTHONS = ("3.10", "3.11", "3.12", "3.13", "3.14")
PROCESSORS = {"amd64": "x86_64", "arm64": "aarch64"}  # as Debian calls them, and as Linux does
PLATFORMS = ("manylinux_2_28", "manylinux2014")
PINNED = Path(__file__).with_name("libraries.txt")
MODULES = ("lcm/", "serial/", "yaml/")
EXTENSION = ".so"
ELF_HEADER = struct.Struct("<4s14xH12xQQ6xHHHHH")  # magic, machine, places of both tables, sizes and counts in them
SEGMENT = struct.Struct("<8xQ16xQ")  # where a segment lies in the file, and how long it is there


def downloaded(
    pip: list[str], architecture: str, folder: Path, pythons: tuple[str, ...] = PYTHONS
) -> dict[str, list[Path]]:
    """Download the wheels for an architecture into a folder, from the package index; return them for each Python.

    Raises SystemExit with pip's words where one cannot be had, or is another than the pinned one.
    """
    found = {}
    for python in pythons:
        there = folder / architecture / python
        command = [*pip, "download", "--quiet", "--no-deps", "--only-binary", ":all:", "--implementation", "cp"]
        command += ["--require-hashes", "--requirement", str(PINNED), "--python-version", python, "--dest", str(there)]
        for platform in PLATFORMS:
            command += ["--platform", f"{platform}_{PROCESSORS[architecture]}"]
        result = subprocess.run(command, capture_output=True, text=True, check=False)
        if result.returncode:
            raise SystemExit(f"{' '.join(command)} failed:\n{result.stdout}{result.stderr}")
        found[python] = sorted(there.glob("*.whl"))
    return found


def files_of(wheels: dict[str, list[Path]], architecture: str) -> dict[str, bytes]:
    """Return the files of libraries for all Pythons, by path in one import root: what runs, and the licences.

    Compiled modules have the names by which each Python finds its own.
    """
    files = {}
    for python, paths in wheels.items():
        for path in paths:
            with zipfile.ZipFile(path) as wheel:
                for name in wheel.namelist():
                    if _is_needed(name):
                        content = wheel.read(name)
                        is_compiled = name.endswith(EXTENSION)
                        files[_name_for(python, architecture, name)] = loaded_part(content) if is_compiled else content
    return files


def loaded_part(library: bytes) -> bytes:
    """Return a shared library without what is not loaded, such as the debugger's tables, most of PyYAML's."""
    magic, _machine, segments, _sections, size, count, *_ = ELF_HEADER.unpack_from(library)
    if magic != b"\x7fELF":
        raise ValueError("no ELF file")
    places = [SEGMENT.unpack_from(library, segments + number * size) for number in range(count)]
    return without_sections(library[: max(start + length for start, length in places)])


def without_sections(library: bytes) -> bytes:
    """Return an ELF file of 64 bits that says that it has no table of sections."""
    return library[:0x28] + bytes(8) + library[0x30:0x3C] + bytes(4) + library[0x40:]


def machine_of(library: bytes) -> int:
    """Return the processor of an ELF file, as elf.h numbers them: 62 is x86-64, 183 is 64-bit ARM."""
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
