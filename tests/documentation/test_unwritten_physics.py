"""The tutorial on laws: its robot is driven, its law is found, kept under a name, and found again by that name."""

import json
import sys
from pathlib import Path
from typing import Any

import pytest

from cmr.model.catalogue import LAWS, unlearn
from cmr.model.laws.grammar import parse
from cmr.parameters.laws import read_law
from tests.support.documentation_blocks import DOCS, blocks_of, command_lines
from tests.support.project import PROJECT

sys.path.insert(0, str(PROJECT / "scripts"))
from documentation.commands import main_of

pytestmark = [pytest.mark.slow, pytest.mark.longest]

PAGE = DOCS / "tutorials" / "unwritten_physics.md"


def diagnosed(folder: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((folder / "diagnosis.json").read_text("utf-8"))
    return content


@pytest.mark.further  # a minute; its commands are parsed by test_blocks.py
def test_the_law_of_the_tutorial_is_found_kept_and_found_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    blocks = list(blocks_of(PAGE))
    (tmp_path / "hidden.yaml").write_text(next(b.text for b in blocks if b.text.startswith("effects:")), "utf-8")
    for block in blocks:
        if block.language == "python":
            exec(compile(block.text, str(block), "exec"), {"__name__": "page"})
    known = set(LAWS)
    try:
        for line in command_lines():
            if line.block.page == "docs/tutorials/unwritten_physics.md" and line.words[0] != "cmr-sim":
                assert main_of(line.words[0])(line.words[1:]) == 0, str(line)
                for name in set(LAWS) - known:  # as a process of its own, each command knows what it is given
                    unlearn(name)
    finally:
        for name in set(LAWS) - known:
            unlearn(name)

    law = diagnosed(tmp_path / "diagnosis")["laws"]["found"][0]
    assert (law["name"], law["place"]) == ("law_yaw_rate_v_to_2_w", "yaw_rate")
    [formula] = law["formulas"]
    # Understeer is w / (1 + k v^2): to first order w minus k v^2 w.
    values = {"v": 0.5, "w": 1.5}
    assert float(parse(formula).evaluate(values)) == pytest.approx(values["v"] ** 2 * values["w"])
    [parameter] = law["parameters"].values()
    assert parameter["unit"] == "s^2/m^2"
    # 0.25 in the plant; at 0.5 m/s the formula is 6 % too large beside 1 / (1 + k v^2).
    assert -0.26 < parameter["value"] < -0.2
    assert law["held_out_path_rmse_ratio"] > 2.0
    assert read_law(tmp_path / "laws" / "law_understeer.yaml").law.formulas == (formula,)
    again = diagnosed(tmp_path / "again")
    assert "law_understeer" in [effect["name"] for effect in again["effects"]]
