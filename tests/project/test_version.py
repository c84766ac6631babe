"""A build's version is that of git's tag, or that of the changelog; commands notice a build that is out of date."""

import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from setuptools.config.pyprojecttoml import read_configuration

from cmr import distribution
from cmr.cli.start import run
from cmr.distribution import FINGERPRINT, fingerprint, outdated_messages
from scripts.build_version import of_changelog, version_of
from tests.support.project import PROJECT

pytestmark = pytest.mark.slow

CHANGES = "# Changes\n\n## 0.3.0, 2027-01-31\n\n- Something.\n\n## 0.2, 2026-12-24\n"


@pytest.fixture
def sources(tmp_path: Path) -> Path:
    (tmp_path / "CHANGELOG.md").write_text(CHANGES)
    return tmp_path


@pytest.fixture
def clone(sources: Path) -> Path:
    if not shutil.which("git"):
        pytest.skip("there is no git")
    git(sources, "init", "--quiet")
    git(sources, "add", ".")
    commit(sources)
    return sources


def git(folder: Path, *arguments: str) -> None:
    somebody = ("-c", "user.name=somebody", "-c", "user.email=somebody@example.org")
    subprocess.run(["git", "-C", str(folder), *somebody, *arguments], check=True, capture_output=True)


def commit(folder: Path) -> None:
    git(folder, "commit", "--quiet", "--allow-empty", "--message", "Something")


def test_without_git_the_newest_heading_names_the_version(sources: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert version_of(sources) == "0.3.0"
    monkeypatch.setenv("PATH", "")
    assert version_of(sources) == "0.3.0"


def test_what_no_release_has_yet_is_told_apart_from_the_release() -> None:
    assert of_changelog(CHANGES.replace("## 0.3.0", "## Unreleased\n\n- More.\n\n## 0.3.0")) == "0.3.0+unreleased"
    assert of_changelog("## 1.2.3, 2027-01-31\n\n## Unreleased\n") == "1.2.3"


def test_a_changelog_without_a_version_ends_the_build_with_what_is_missing() -> None:
    with pytest.raises(SystemExit, match=r"a heading like '## 0\.1\.0, 2026-11-25' is missing"):
        of_changelog("# Changes\n\n- Something.\n")


def test_a_clone_without_tags_is_what_the_changelog_says(clone: Path) -> None:
    git(clone, "tag", "before-the-move")
    assert version_of(clone) == "0.3.0"


def test_a_tag_names_the_version_and_later_commits_are_counted(clone: Path) -> None:
    git(clone, "tag", "v0.4.0rc1")
    assert version_of(clone) == "0.4.0rc1"
    commit(clone)
    git(clone, "tag", "-a", "v0.4.0", "-m", "Something")
    assert version_of(clone) == "0.4.0"
    for _ in range(2):
        commit(clone)
    assert re.fullmatch(r"0\.4\.0\.post2\+g[0-9a-f]{10}", version_of(clone))


def test_a_copy_inside_a_clone_of_something_else_has_a_version_of_its_own(clone: Path) -> None:
    git(clone, "tag", "v7.0")
    copy = clone / "copy"
    copy.mkdir()
    (copy / "CHANGELOG.md").write_text(CHANGES)
    assert version_of(copy) == "0.3.0"


def test_a_source_distribution_says_what_it_is(clone: Path) -> None:
    git(clone, "tag", "v0.4.0")
    (clone / "PKG-INFO").write_text("Metadata-Version: 2.4\nName: cmr\nVersion: 0.2.9.post3\n")
    assert version_of(clone) == "0.2.9.post3"


def test_the_build_takes_it(tmp_path: Path) -> None:
    for name in ("pyproject.toml", "CHANGELOG.md", "README.md"):
        shutil.copy2(PROJECT / name, tmp_path)
    (tmp_path / "scripts").mkdir()
    shutil.copy2(PROJECT / "scripts" / "build_version.py", tmp_path / "scripts")
    read = read_configuration(tmp_path / "pyproject.toml", ignore_option_errors=True)  # such as missing packages
    assert read["project"]["version"] == of_changelog((tmp_path / "CHANGELOG.md").read_text(encoding="utf-8"))


def test_the_citation_names_the_newest_release_and_its_date() -> None:
    citation = yaml.safe_load((PROJECT / "CITATION.cff").read_text(encoding="utf-8"))
    changes = (PROJECT / "CHANGELOG.md").read_text(encoding="utf-8")
    newest = re.search(r"^## (\d\S*), (\d{4}-\d\d-\d\d)$", changes, re.MULTILINE)
    assert newest is not None
    assert (citation["version"], str(citation["date-released"])) == newest.groups()


def test_commands_of_a_checkout_whose_messages_changed_ask_to_be_installed_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    message = tmp_path / "lcmtypes" / "one_t.lcm"
    for folder in (message.parent, tmp_path / "cmr" / "msg"):
        folder.mkdir(parents=True)
    (tmp_path / "pyproject.toml").touch()
    message.write_text("struct one_t { double x; }")
    assert outdated_messages(tmp_path), "the classes are from before fingerprints were written"
    (tmp_path / "cmr" / "msg" / FINGERPRINT).write_text(fingerprint(message.parent))
    assert not outdated_messages(tmp_path)
    message.write_text("struct one_t { double x; double y; }")
    assert outdated_messages(tmp_path)

    monkeypatch.setattr(distribution, "outdated_messages", lambda: True)
    monkeypatch.setattr(signal, "signal", lambda *_: None)  # pytest keeps its own
    monkeypatch.setattr(sys, "argv", ["/usr/bin/cmr-sim"])
    assert run("cmr.commands.sim") == 1
    assert capsys.readouterr().err.startswith("cmr-sim: the messages in lcmtypes/ have changed")


def test_an_installation_without_message_types_is_never_outdated(tmp_path: Path) -> None:
    (tmp_path / "cmr" / "msg").mkdir(parents=True)
    assert not outdated_messages(tmp_path)
