"""Determine the version to build: from git's tag, or from the changelog if git or tags are absent.

The build calls this through pyproject.toml. A tag `v0.1.0` means version 0.1.0; 12 commits later, the version is
0.1.0.post12+gab12cd34ef. A source distribution contains its version. For an archive without git, it is the newest
heading of CHANGELOG.md: 0.1.0, or 0.1.0+unreleased if a heading "Unreleased" comes before it.
"""

import re
import subprocess
from pathlib import Path

PROJECT = Path(__file__).resolve().parent.parent
TAGS = "v[0-9]*"


def version_of(folder: Path) -> str:
    """Return the version of the sources in a folder."""
    return _of_distribution(folder) or _of_tag(folder) or of_changelog((folder / "CHANGELOG.md").read_text("utf-8"))


def of_changelog(text: str) -> str:
    """Return the newest version of a changelog; raises SystemExit, which ends the build, if it has none."""
    headings = re.findall(r"^## (Unreleased|\d+(?:\.\d+)+)\b", text, re.MULTILINE)
    versions = [heading for heading in headings if heading != "Unreleased"]
    if not versions:
        raise SystemExit("CHANGELOG.md names no version: a heading like '## 0.1.0, 2026-11-25' is missing.")
    return str(versions[0]) + ("+unreleased" if headings[0] == "Unreleased" else "")


def _of_distribution(folder: Path) -> str:
    """Return the version in the metadata of a source distribution; empty if the folder is none."""
    try:
        text = (folder / "PKG-INFO").read_text("utf-8")
    except OSError:
        return ""
    found = re.search(r"^Version: (\S+)$", text, re.MULTILINE)
    return found[1] if found else ""


def _of_tag(folder: Path) -> str:
    """Return the version of the newest tag of a clone; empty if git, the clone or a tag is missing."""
    # The sources may be in a clone of another repository.
    if _git(folder, "rev-parse", "--show-toplevel") != str(folder.resolve()):
        return ""
    # A fixed number of digits of the commit, independent of the clone.
    described = _git(folder, "describe", "--tags", "--long", "--abbrev=10", "--match", TAGS)
    found = re.fullmatch(r"v(.+)-(\d+)-(g[0-9a-f]+)", described)
    if not found:
        return ""
    version, commits, commit = found.groups()
    return version if commits == "0" else f"{version}.post{commits}+{commit}"


def _git(folder: Path, *arguments: str) -> str:
    try:
        result = subprocess.run(
            ["git", "-C", str(folder), *arguments], capture_output=True, encoding="utf-8", check=False
        )
    except OSError:
        return ""
    return result.stdout.strip() if result.returncode == 0 else ""


VERSION = version_of(PROJECT)
