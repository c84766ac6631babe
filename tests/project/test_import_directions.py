"""Imports run one way, as ARCHITECTURE.md says: who is below does not know who is above."""

import ast
import re
import sys
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path

import pytest

from tests.support.project import PROJECT

sys.path.insert(0, str(PROJECT / "scripts"))
from documentation.imports import (
    GENERATED,
    LATE,
    TOP,
    TYPING,
    Import,
    cycles,
    folder_of,
    imported_by,
    imports,
    modules,
    package_of,
    parsed,
)
from documentation.layers import PICTURE, picture

BUS = {"cmr.msg", "cmr.cli", "cmr.bus", "cmr.plain_text"}
RECORDED = {*BUS, "cmr.model", "cmr.parameters", "cmr.recordings"}
# Each package, from the ground to the top, with those that it may import: all of them are above it in this table.
KNOWN: dict[str, set[str]] = {
    # The ground: it knows no robot.
    "cmr.distribution": set(),
    "cmr": {"cmr.distribution"},  # and, by name at the first use, what `import cmr` offers
    "cmr.litter": set(),
    "cmr.files": {"cmr.litter"},
    "cmr.plain_text": set(),
    "cmr.priority": set(),
    "cmr.threads": set(),
    "cmr.workers": {"cmr.threads"},
    "cmr.documents": {"cmr.files", "cmr.plain_text"},
    "cmr.cli": {"cmr.distribution", "cmr.documents", "cmr.files", "cmr.plain_text"},
    "cmr.report": set(),
    # Robots: how they move, what they say.
    "cmr.msg": set(),
    "cmr.model": {"cmr.litter"},
    "cmr.plant": set(),  # the judge of the model, with which it shares no code
    "cmr.geometry": {"cmr.model", "cmr.documents", "cmr.files"},
    "cmr.bus": {"cmr.msg", "cmr.cli", "cmr.files", "cmr.plain_text"},
    "cmr.parameters": {*BUS, "cmr.documents", "cmr.files", "cmr.model"},
    "cmr.recordings": {*BUS, "cmr.files", "cmr.model", "cmr.parameters"},
    # What is found out about robots, and the world in which they are.
    "cmr.camera": {"cmr.msg", "cmr.documents", "cmr.files"},
    "cmr.tracker": {*BUS, "cmr.distribution", "cmr.documents", "cmr.files"},
    "cmr.estimation": {*RECORDED, "cmr.geometry"},
    "cmr.calibration": {*RECORDED, "cmr.report", "cmr.geometry", "cmr.estimation"},
    "cmr.diagnosis": {
        *RECORDED,
        *("cmr.report", "cmr.distribution", "cmr.files", "cmr.workers", "cmr.geometry", "cmr.estimation"),
    },
    "cmr.exporting": {*RECORDED, "cmr.files", "cmr.plant", "cmr.report", "cmr.estimation", "cmr.diagnosis"},
    "cmr.world": {*RECORDED, "cmr.report", "cmr.geometry"},
    "cmr.investigation": {*RECORDED, "cmr.geometry", "cmr.estimation", "cmr.report", "cmr.world"},
    "cmr.view": {*RECORDED, "cmr.litter", "cmr.report", "cmr.geometry"},
    "cmr.teleop": {*RECORDED, "cmr.geometry", "cmr.world"},
    "cmr.robot_log": {*RECORDED, "cmr.report", "cmr.calibration", "cmr.diagnosis", "cmr.distribution"},
    # Teams.
    "cmr.processes": {*BUS, "cmr.files"},  # on robots' own computers, too
    "cmr.experiments": set(),
    "cmr.experiments.team": {*RECORDED, "cmr.geometry", "cmr.plant", "cmr.world"},
    "cmr.experiments.scenario": {*RECORDED, "cmr.documents", "cmr.geometry", "cmr.world", "cmr.experiments.team"},
    "cmr.experiments.live": {
        *RECORDED,
        *("cmr.files", "cmr.geometry", "cmr.report", "cmr.world", "cmr.experiments.team", "cmr.experiments.scenario"),
        *("cmr.documents", "cmr.processes"),
    },
    "cmr.experiments.sweep": {
        *RECORDED,
        *("cmr.distribution", "cmr.files", "cmr.report", "cmr.world", "cmr.experiments.team"),
        *("cmr.documents", "cmr.experiments.scenario"),
    },
    "cmr.experiments.fidelity": {
        *RECORDED,
        *("cmr.files", "cmr.workers", "cmr.report", "cmr.estimation", "cmr.calibration", "cmr.diagnosis"),
        *("cmr.geometry", "cmr.experiments.team"),
    },
    "cmr_tools": {
        *RECORDED,
        "cmr.geometry",
        "cmr.documents",
        "cmr.files",
        "cmr.litter",
        "cmr.report",
        "cmr.distribution",
    },
    # Devices: they may import cmr, never the reverse, but for the commands.
    "robot_driver.guided": set(),  # any procedure, of any program
    "robot_driver.terminals": set(),
    "robot_driver.gyros": set(),
    "robot_driver.gate": set(),  # a process of its own, which has to be small
    "robot_driver.controllers": {"cmr.msg", "robot_driver.gate", "robot_driver.gyros"},
    "robot_driver": {
        *(*BUS, "cmr.parameters", "cmr.model", "cmr.documents", "cmr.files", "cmr.priority"),
        *("robot_driver.controllers", "robot_driver.gate", "robot_driver.gyros"),
    },
    "robot_driver.bringup": {
        *(*BUS, "cmr.parameters", "cmr.model", "cmr.files"),
        *("robot_driver", "robot_driver.controllers", "robot_driver.guided"),
    },
    "robot_driver.emulator": {
        *(*BUS, "cmr.documents", "cmr.priority", "cmr.model", "cmr.plant", "robot_driver", "robot_driver.terminals"),
    },
    "robot_driver.acceptance": {
        *(*BUS, "cmr.distribution", "cmr.priority", "cmr.report", "robot_driver", "robot_driver.guided"),
        *("robot_driver.controllers", "robot_driver.gate", "robot_driver.gyros", "robot_driver.terminals"),
    },
    "robot_driver.simulated": {
        *(*BUS, "cmr.parameters", "cmr.model", "cmr.world", "robot_driver", "robot_driver.emulator"),
        *("robot_driver.bringup", "robot_driver.controllers", "robot_driver.guided"),
    },
    "robot_driver.ros2": {
        *(*RECORDED, "cmr.documents", "cmr.files", "cmr.geometry", "robot_driver", "robot_driver.emulator"),
    },
    # The top: processes.
    "cmr.commands": {
        *(*RECORDED, "cmr.documents", "cmr.files", "cmr.distribution", "cmr.priority", "cmr.threads", "cmr.geometry"),
        *("cmr.camera", "cmr.estimation", "cmr.calibration", "cmr.diagnosis", "cmr.world", "cmr.view"),
        *("cmr.teleop", "cmr.tracker", "cmr.exporting"),
        *("cmr.experiments.team", "cmr.experiments.scenario", "cmr.experiments.live", "cmr.experiments.sweep"),
        *("cmr.experiments.fidelity", "robot_driver", "robot_driver.controllers", "robot_driver.gyros"),
        *("robot_driver.terminals", "robot_driver.emulator", "robot_driver.bringup", "robot_driver.ros2"),
        *("cmr_tools", "cmr.processes"),
        *("cmr.investigation", "cmr.plant", "robot_driver.simulated"),
    },
    "cmr.__main__": {"cmr.commands"},
}
OF_DRIVER = ("robot_driver", "robot_driver.controllers", "robot_driver.gate", "robot_driver.gyros")
# Late imports within one package that go against its order, and why. Everything else runs one way from file to file.
AGAINST_THE_ORDER = {
    ("cmr.calibration.result", "cmr.calibration.plots"): "a result draws itself, for who has only the result",
    ("cmr.diagnosis.result", "cmr.diagnosis.summary"): "a result says what it is, for who has only the result",
    ("cmr.model.motion", "cmr.model.fleet"): "drive() imports Numba, for which who never simulates does not wait",
    ("cmr.world.behaviours.paths", "cmr.world.behaviours.path_following"): "compiled loops, which import Numba",
}
# Modules that import a module by a computed name, and the source of that name.
BY_COMPUTED_NAME = {
    "cmr": "the table of what `import cmr` offers",
    "cmr.cli.start": "the command's own entry, which names a module",
    "cmr.commands.completion": "the table of commands",
    "cmr.commands.first_use": "packages whose compiled functions are compiled ahead",
    "cmr.world.behaviours.making": "behaviours, also those of a user",
    "cmr.world.lazy_module": "the module's own user, which names it as a constant",
    "robot_driver.acceptance.command": "a constant of the module: the page, which needs a library",
    "robot_driver.ros2.node": "messages of ROS 2",
}
MOST_FILES = 25  # of a package; a reader can have that many names in view


@pytest.fixture(scope="module")
def sources() -> dict[str, Path]:
    return modules()


@pytest.fixture(scope="module")
def found(sources: dict[str, Path]) -> list[Import]:
    return imports(sources)


def test_every_package_has_its_place(sources: dict[str, Path]) -> None:
    assert {package_of(name, sources) for name in sources} | {"cmr"} == set(KNOWN)


def test_the_table_runs_one_way() -> None:
    above: set[str] = set()
    for package, known in KNOWN.items():
        assert known <= above, f"{package} is to know {known - above}, below it in the table"
        above.add(package)


@pytest.mark.parametrize("package", KNOWN)
def test_a_package_knows_only_those_below_it(package: str, sources: dict[str, Path], found: list[Import]) -> None:
    wrong = [
        f"{one.importer} imports {one.imported}"
        for one in found
        if package_of(one.importer, sources) == package
        and one.kind != TYPING
        and package_of(one.imported, sources) not in {*KNOWN[package], package}
    ]
    assert wrong == []


def test_types_alone_make_no_package_known_either(sources: dict[str, Path], found: list[Import]) -> None:
    """What is imported for type checkers is a dependency for the reader, too; `cmr` itself types what it offers."""
    wrong = [
        f"{one.importer} imports {one.imported}"
        for one in found
        if one.kind == TYPING
        and one.importer != "cmr"
        and package_of(one.imported, sources) not in {*KNOWN[(own := package_of(one.importer, sources))], own}
    ]
    assert wrong == []


def graph_of(found: Iterable[Import], *kinds: str) -> dict[str, set[str]]:
    """Who imports whom among files, in one of these ways, but for what goes AGAINST_THE_ORDER."""
    graph: defaultdict[str, set[str]] = defaultdict(set)
    for one in found:
        if one.kind in kinds and (one.importer, one.imported) not in AGAINST_THE_ORDER:
            graph[one.importer].add(one.imported)
    return graph


def test_files_import_one_another_in_no_circle(found: list[Import]) -> None:
    assert cycles(graph_of(found, TOP, LATE)) == []


def test_the_exceptions_are_needed(found: list[Import]) -> None:
    late = {(one.importer, one.imported) for one in found if one.kind == LATE}
    assert set(AGAINST_THE_ORDER) <= late
    for pair in AGAINST_THE_ORDER:
        graph = graph_of(found, TOP, LATE)
        graph[pair[0]].add(pair[1])
        assert cycles(graph), f"{pair} is no exception"


def test_the_driver_knows_neither_world_nor_model(sources: dict[str, Path], found: list[Import]) -> None:
    known = {one.imported for one in found if package_of(one.importer, sources) in OF_DRIVER}
    # Of the model only the ramp, plain arithmetic: the driver works where neither NumPy nor Numba is.
    assert {name for name in known if name.startswith(("cmr.world", "cmr.model"))} == {"cmr.model.duty_ramp"}


def test_no_module_imports_tests_or_scripts(sources: dict[str, Path]) -> None:
    found = {
        (module, name.partition(".")[0])
        for module, path in sources.items()
        if module != GENERATED
        for name, _ in imported_by(parsed(path))
    }
    assert {pair for pair in found if pair[1] in ("tests", "scripts", "tools")} == set()


def test_only_known_modules_import_by_a_computed_name(sources: dict[str, Path]) -> None:
    computed = set()
    for module, path in sources.items():
        for call in ast.walk(parsed(path)) if module != GENERATED else ():
            if isinstance(call, ast.Call) and ast.unparse(call.func).split(".")[-1] in ("import_module", "__import__"):
                known = len(call.args) == 1 and isinstance(call.args[0], ast.Constant)
                computed |= set() if known else {module}
    assert computed == set(BY_COMPUTED_NAME)


def test_a_package_is_small_enough_to_be_read(sources: dict[str, Path]) -> None:
    count: defaultdict[str, int] = defaultdict(int)
    for name in sources:
        count[folder_of(name, sources)] += 1
    larger = {package: files for package, files in count.items() if files > MOST_FILES}
    assert larger == {}, "parts of them belong into packages of their own, or together"


def test_imports_inside_functions_of_whole_packages_and_by_name_are_seen(tmp_path: Path) -> None:
    texts = {
        "cmr/__init__.py": "",
        "cmr/low.py": "import robot_driver\ndef late():\n    from cmr import high\n",
        "cmr/high.py": "import cmr.low\nTYPE_CHECKING = False\nif TYPE_CHECKING:\n    import cmr.third\n",
        "cmr/third.py": 'loops = LazyModule("cmr.low")\n',
        "robot_driver/__init__.py": "from cmr.low import late\n",
    }
    for name, text in texts.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    found = imports(modules(tmp_path))
    assert set(found) == {
        Import("cmr.low", "robot_driver", TOP),
        Import("cmr.low", "cmr.high", LATE),
        Import("cmr.high", "cmr.low", TOP),
        Import("cmr.high", "cmr.third", TYPING),
        Import("cmr.third", "cmr.low", LATE),
        Import("robot_driver", "cmr.low", TOP),
    }
    assert cycles(graph_of(found, TOP, LATE)) == [{"cmr.high", "cmr.low", "robot_driver"}]


@pytest.mark.slow
def test_the_picture_of_the_architecture_is_made_from_the_imports() -> None:
    assert PICTURE.read_text(encoding="utf-8") == picture(), "run scripts/write_architecture_picture"


def test_every_file_and_folder_that_the_architecture_names_is_there() -> None:
    text = (PROJECT / "ARCHITECTURE.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`((?:cmr|robot_driver|tools|lcmtypes|tests|scripts)/[\w/.]*)`", text))
    assert {name for name in named if not (PROJECT / name).exists()} == set()


def test_the_data_paths_take_as_many_files_as_they_say() -> None:
    text = (PROJECT / "ARCHITECTURE.md").read_text(encoding="utf-8").partition("## Four data paths")[2]
    ways = re.findall(r"\*\*(.+?)\*\* \((\d+) files\)(.+?)(?=\n\n|$)", text, re.DOTALL)
    assert len(ways) == 4
    for name, files, way in ways:
        assert len(set(re.findall(r"`([\w/]+\.py)`", way))) == int(files), name
