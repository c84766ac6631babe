"""The documentation's site builds without a warning and without the network, and its links lead somewhere."""

import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urldefrag

import pytest

from tests.support.documentation_blocks import DOCS
from tests.support.project import PROJECT

sys.path.insert(0, str(PROJECT / "scripts"))
from documentation.commands import modules
from documentation.message_page import read
from documentation.notebook_pages import pages as notebook_pages

pytestmark = pytest.mark.slow

# Captures the parsers of all commands where only the extra `docs` is installed.
WITHOUT_EXTRAS = """
import sys

class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in "cv2 dask distributed lz4 mcap pandas pyarrow rosbags viser zstandard".split():
            raise ModuleNotFoundError(name, name=name)

sys.meta_path.insert(0, Missing())
sys.path[:0] = [PROJECT, PROJECT + "/scripts"]
from documentation.commands import modules, parsers_of
assert all(parsers_of(command) for command in modules() if command != "cmr")
"""


class Page(HTMLParser):
    """The targets of a page's links and pictures, and the places that links can lead to."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.targets: set[str] = set()
        self.anchors: set[str] = set()
        self.feed(path.read_text("utf-8"))

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        for name, value in attributes:
            if name == "id" and value:
                self.anchors.add(value)
            elif value and name in ("href", "src") and tag in ("a", "img", "link", "script"):
                self.targets.add(value)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site, built as scripts/docs builds it."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "sphinx", "--quiet", "--fail-on-warning", "--keep-going", "-b", "html"]
    done = subprocess.run([*command, str(DOCS), str(folder)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return folder


def pages_of(site: Path) -> list[Path]:
    """Return the pages of the site; the theme has templates beside its scripts."""
    return [path for path in site.rglob("*.html") if "_static" not in path.parts]


def test_every_link_and_picture_of_the_site_leads_somewhere(site: Path) -> None:
    pages = {path: Page(path) for path in pages_of(site)}
    assert len(pages) > 50
    lost = []
    for path, page in pages.items():
        for target in page.targets:
            address, anchor = urldefrag(target)
            if re.match(r"[a-z]+:|//", address):
                continue
            to = (path.parent / unquote(address).split("?")[0]).resolve() if address else path
            if not to.is_file() or (anchor and to in pages and anchor not in pages[to].anchors):
                lost.append(f"{path.relative_to(site)}: {target}")
    assert not lost


def test_nothing_of_a_page_comes_from_another_site(site: Path) -> None:
    for path in pages_of(site):
        for tag in re.findall(r"<(?:script|link|img)\b[^>]*>", path.read_text("utf-8")):
            assert not re.search(r"""(?:src|href)="(?:https?:)?//""", tag), f"{path.name}: {tag}"


def test_every_command_and_message_has_its_reference(site: Path) -> None:
    messages = (site / "reference/generated/messages.html").read_text("utf-8")
    for path in (PROJECT / "lcmtypes").glob("*.lcm"):
        message = read(path.read_text("utf-8"))
        assert message.name == path.stem
        assert message.fields
        assert all(kind and meaning for _names, kind, meaning in message.fields + message.constants)
        assert f'id="{path.stem.replace("_", "-")}"' in messages
    for command in modules():
        page = site / "reference/generated/commands" / f"{command.replace(' ', '-')}.html"
        assert command == "cmr" or "--help" in page.read_text("utf-8")


def test_the_pages_of_commands_need_no_extra_but_docs() -> None:
    program = f"PROJECT = {str(PROJECT)!r}\n{WITHOUT_EXTRAS}"
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr


def test_readme_is_short_and_its_links_lead_somewhere() -> None:
    text = (PROJECT / "README.md").read_text("utf-8")
    assert len(text.splitlines()) <= 200
    for target in re.findall(r"\]\((?!https?:)([^)#]+)\)", text):
        assert (PROJECT / target).is_file(), target


def test_a_notebook_becomes_a_page_with_what_its_cells_gave(tmp_path: Path) -> None:
    notebook = tmp_path / "calibrate.ipynb"
    notebook.write_text(
        '{"cells": [{"cell_type": "markdown", "source": ["# Calibrate"]},'
        '{"cell_type": "code", "source": ["1 + 1"], "outputs": ['
        '{"output_type": "execute_result", "data": {"text/plain": ["2"], "image/png": "iVBORw=="}},'
        '{"output_type": "stream", "text": ["done\\n"]}]}]}',
        "utf-8",
    )
    files = notebook_pages([notebook])
    assert files["notebooks/calibrate_1.png"] == b"\x89PNG"
    page = files["notebooks/calibrate.md"].decode()
    assert page.startswith("# Calibrate\n\n```python\n1 + 1\n```\n")
    assert "(calibrate_1.png)" in page
    assert "```text\ndone\n```" in page
    assert b"notebooks/calibrate\n" in files["notebooks.md"]
