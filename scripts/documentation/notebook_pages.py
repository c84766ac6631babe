"""Generate pages from the notebooks in docs/notebooks, in MyST Markdown: cells with their text and pictures."""

import base64
import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

INTRODUCTION = """\
# Notebooks

These notebooks are in `docs/notebooks/` of the checkout. Open them with Jupyter to change them.
"""


def pages(notebooks: Iterable[Path]) -> dict[str, bytes]:
    """Return the files for all notebooks by name: notebooks.md, a page for each notebook, and their pictures."""
    result: dict[str, bytes] = {}
    names = []
    for path in notebooks:
        name = f"notebooks/{path.stem}"
        names.append(name)
        lines: list[str] = []
        for number, cell in enumerate(json.loads(path.read_text("utf-8"))["cells"]):
            lines += _source(cell)
            for kind, data in _outputs(cell):
                if kind == "image/png":
                    result[f"{name}_{number}.png"] = base64.b64decode(data)
                    lines.append(f"![Output of the cell above]({path.stem}_{number}.png)\n")
                else:
                    lines.append(f"```text\n{data.rstrip()}\n```\n")
        result[f"{name}.md"] = "\n".join(lines).encode()
    contents = f"```{{toctree}}\n:maxdepth: 1\n\n{chr(10).join(names)}\n```\n" if names else ""
    return result | {"notebooks.md": f"{INTRODUCTION}\n{contents}".encode()}


def _source(cell: dict[str, Any]) -> Iterator[str]:
    source = "".join(cell["source"]).rstrip()
    if cell["cell_type"] == "markdown":
        yield f"{source}\n"
    elif source:
        yield f"```python\n{source}\n```\n"


def _outputs(cell: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Return the kind and the data of each output that can be shown on a page."""
    for output in cell.get("outputs", ()):
        if output["output_type"] == "stream":
            yield "text/plain", "".join(output["text"])
        data = output.get("data", {})
        for kind in ("image/png", "text/plain"):
            if kind in data:
                yield kind, "".join(data[kind])
                break
