"""Find the recordings of a command line, the files of each, and the names of their logs."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from glob import glob, has_magic
from pathlib import Path

from cmr.cli.errors import CommandError
from cmr_tools.importing.mapping_types import CSV_TABLE, Mapping
from cmr_tools.importing.ros_files import files_of
from cmr_tools.importing.sources import SourceError

PACKED = (".gz", ".zstd")
MOST_NAMES = 10  # listed in an error


@dataclass(frozen=True)
class Recorded:
    """One recording: its name on the command line, and its `files`, by their names in the mapping.

    `place` is the path of its log beside it, without a suffix.
    """

    path: Path
    files: dict[str, Path]
    place: Path


def paths_of(inputs: Sequence[str]) -> list[Path]:
    """Return the paths, each once; patterns (`*`, `?`, `[...]`, and `**` for folders) are resolved.

    Raises CommandError for a pattern that matches nothing.
    """
    paths: list[Path] = []
    for text in inputs:
        if Path(text).exists() or not has_magic(text):
            paths.append(Path(text))
            continue
        found = sorted(glob(text, recursive=True))  # noqa: PTH207 (Path.glob takes no absolute pattern)
        if not found:
            raise CommandError(f"{text}: nothing fits this pattern")
        paths += map(Path, found)
    return list(dict.fromkeys(paths))


def recorded(mapping: Mapping, path: Path) -> Recorded:
    """Return the recording at a path.

    Raises SourceError where one of its files is missing or cannot be found out, BagError for a folder without a bag,
    OSError when a folder cannot be read.
    """
    if mapping.topics:
        return Recorded(path, {file.name: file for file in files_of(path)}, _without_ending(path))
    if mapping.channels or CSV_TABLE in mapping.files:
        return Recorded(path, {CSV_TABLE: path}, _without_ending(path))
    if path.is_dir():
        return Recorded(path, {pattern: _only(path, pattern) for pattern in mapping.files}, path)
    return _by_one_of_its_files(mapping, path)


def logs_of(recordings: Sequence[Recorded], folder: Path) -> list[Path]:
    """Return the log of each recording: below `folder` as the recordings lie below the folder that they share.

    Raises CommandError if two would be the same.
    """
    if not recordings:
        return []
    places = [one.place.parent.resolve() / one.place.name for one in recordings]
    shared = Path(os.path.commonpath([place.parent for place in places]))
    logs = [folder / place.relative_to(shared).with_name(f"{place.name}.lcm") for place in places]
    first: dict[Path, Recorded] = {}
    for log, one in zip(logs, recordings, strict=True):
        if log in first:
            raise CommandError(f"{first[log].path} and {one.path} would both become {log}; import them apart")
        first[log] = one
    return logs


def _without_ending(path: Path) -> Path:
    path = path if path.name else path.resolve()
    if path.is_dir():
        return path
    return _unpacked(path).with_suffix("")


def _unpacked(path: Path) -> Path:
    return path.with_suffix("") if path.suffix in PACKED else path


def _fits(name: str, pattern: str) -> bool:
    before, star, after = pattern.partition("*")
    return (
        name.startswith(before) and name.endswith(after) and len(name) >= len(before + after)
        if star
        else name == pattern
    )


def _only(folder: Path, pattern: str) -> Path:
    """Return the only file of a folder that matches."""
    present = sorted(file for file in folder.iterdir() if file.is_file())
    fitting = [file for file in present if _fits(_unpacked(file).name, pattern)]
    if len(fitting) == 1:
        return fitting[0]
    if not fitting:
        raise SourceError(f"{folder}: no file {pattern}; there is {_listed(present)}")
    raise SourceError(f"{folder}: several files {pattern}: {_listed(fitting)}. Name one of them, not the folder")


def _by_one_of_its_files(mapping: Mapping, path: Path) -> Recorded:
    """Return the recording of which `path` is one file: the others are beside it."""
    if not path.exists():
        raise SourceError(f"{path}: no such file or folder")
    name = _unpacked(path).name
    pattern = max((one for one in mapping.files if _fits(name, one)), key=len, default=None)
    if pattern is None:
        raise SourceError(f"{path}: is called like none of the files of the mapping: {', '.join(mapping.files)}")
    before, star, after = pattern.partition("*")
    common = name[len(before) : len(name) - len(after)] if star else "*"
    files = {}
    for other in mapping.files:
        wanted = path.with_name(other.replace("*", common))
        beside = [wanted, *(wanted.with_name(wanted.name + ending) for ending in PACKED)]
        present = next((file for file in beside if file.exists()), None)
        files[other] = path if other == pattern else present or _only(path.parent, wanted.name)
    own = common.strip("._- ")
    return Recorded(path, files, path.with_name(own) if star and own else path.resolve().parent)


def _listed(files: Sequence[Path]) -> str:
    names = ", ".join(file.name for file in files[:MOST_NAMES]) or "nothing"
    return names + (f" and {len(files) - MOST_NAMES} more" if len(files) > MOST_NAMES else "")
