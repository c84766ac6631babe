"""Say which version is built: that of git's tag, or where git or tags are absent, that of the changelog.

The build calls this through pyproject.toml. A tag `v0.1.0` names version 0.1.0; 12 commits later it is
0.1.0.post12+gab12cd34ef. In a source distribution, it is what stands there already. An archive without git has the
newest heading of CHANGELOG.md: 0.1.0, or 0.1.0+unreleased where a heading "Unreleased" comes before it.
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
    """Return the newest version of a changelog; raises SystemExit, which ends the build, where it has none."""
    headings = re.findall(r"^## (Unreleased|\d+(?:\.\d+)+)\b", text, re.MULTILINE)
    versions = [heading for heading in headings if heading != "Unreleased"]
    if not versions:
        raise SystemExit("CHANGELOG.md names no version: a heading like '## 0.1.0, 2026-11-25' is missing.")
    return str(versions[0]) + ("+unreleased" if headings[0] == "Unreleased" else "")


def _of_distribution(folder: Path) -> str:
    """Return what the information of a source distribution says; nothing where this is none."""
    try:
        text = (folder / "PKG-INFO").read_text("utf-8")
    except OSError:
        return ""
    found = re.search(r"^Version: (\S+)$", text, re.MULTILINE)
    return found[1] if found else ""


def _of_tag(folder: Path) -> str:
    """Return what the newest tag of a clone says; nothing where git, the clone or a tag is missing."""
    # A copy of the sources may lie in a clone of something else.
    if _git(folder, "rev-parse", "--show-toplevel") != str(folder.resolve()):
        return ""
    # So many digits of the commit in every clone, however much else it holds.
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
