"""Read the import graph from the sources, for the test of the layers and the picture in ARCHITECTURE.md."""

import ast
from collections.abc import Iterable, Iterator, Mapping, Set
from functools import cache
from pathlib import Path
from typing import NamedTuple

PROJECT = Path(__file__).resolve().parents[2]
ROOTS = ("cmr", "robot_driver", "tools/cmr_tools")  # folders of the packages
GENERATED = "cmr.msg"
# Calls whose argument is the name of a module that is imported later; `run` is that of cmr.cli.start.
LATE_BY_NAME = ("LazyModule", "import_module", "run")
TOP, LATE, TYPING = "top", "late", "typing"


class Import(NamedTuple):
    """An import between modules; `kind`: at the top, late (in a function, or by name), or for type checkers only."""

    importer: str
    imported: str
    kind: str


def modules(project: Path = PROJECT) -> dict[str, Path]:
    """Return the modules of both packages by their full names; the generated messages count as one."""
    found = {}
    paths = [(root, path) for root in ROOTS for path in sorted((project / root).rglob("*.py"))]
    for root, path in paths:
        parts = path.relative_to((project / root).parent).with_suffix("").parts
        name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
        if GENERATED not in (name, name.rpartition(".")[0]):
            found[name] = path
    return {GENERATED: project / "cmr" / "msg", **found}


def imports(sources: Mapping[str, Path]) -> list[Import]:
    """Return the imports among modules; of several imports of the same module, only the strongest kind counts."""
    found: dict[tuple[str, str], str] = {}
    for module, path in sources.items():
        if module == GENERATED:
            continue
        for name, kind in imported_by(parsed(path)):
            imported = _known(name, sources)
            if imported and imported != module:
                kinds = {kind, found.get((module, imported), kind)}
                found[module, imported] = next(each for each in (TOP, LATE, TYPING) if each in kinds)
    return [Import(*pair, kind) for pair, kind in found.items()]


@cache
def parsed(path: Path) -> ast.Module:
    """Return the syntax tree of a source, which callers do not change."""
    return ast.parse(path.read_text(encoding="utf-8"))


def imported_by(node: ast.AST, kind: str = TOP) -> Iterator[tuple[str, str]]:
    """Yield the names that a source imports, with the kind of each import."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.Import):
            yield from ((alias.name, kind) for alias in child.names)
        elif isinstance(child, ast.ImportFrom):
            if child.level or child.module is None:
                raise ValueError("imports must be absolute, so that a reader sees where they lead")
            yield from ((f"{child.module}.{alias.name}", kind) for alias in child.names)
        elif isinstance(child, ast.Call) and _name(child.func) in LATE_BY_NAME:
            named = [argument.value for argument in child.args if isinstance(argument, ast.Constant)]
            yield from ((name, LATE) for name in named if isinstance(name, str))
        inside = LATE if isinstance(child, (ast.FunctionDef, ast.AsyncFunctionDef)) and kind == TOP else kind
        if isinstance(child, ast.If) and _name(child.test) == "TYPE_CHECKING":
            inside = TYPING
        yield from imported_by(child, inside)


def _name(node: ast.AST) -> str:
    return node.id if isinstance(node, ast.Name) else node.attr if isinstance(node, ast.Attribute) else ""


def _known(name: str, sources: Mapping[str, Path]) -> str:
    """Return the module of a dotted name, empty if it is not part of this project."""
    while name and name not in sources:
        name = name.rpartition(".")[0]
    return "" if name == "cmr" else name  # the package cmr imports its modules only when they are used


def folder_of(module: str, sources: Mapping[str, Path]) -> str:
    """Return the package that contains a module; a package contains itself."""
    return module if sources[module].name in ("__init__.py", "msg") else module.rpartition(".")[0]


def package_of(module: str, sources: Mapping[str, Path]) -> str:
    """Return the package of the architecture to which a module belongs.

    It is `cmr_tools`, or a folder or module directly in `cmr`, `cmr.experiments` or `robot_driver`; deeper modules
    belong to it.
    """
    if module.startswith("cmr_tools"):
        return "cmr_tools"
    if module.startswith("robot_driver"):
        return ".".join(folder_of(module, sources).split(".")[:2])
    return ".".join(module.split(".")[: 3 if module.startswith("cmr.experiments.") else 2])


def between_packages(found: Iterable[Import], sources: Mapping[str, Path]) -> dict[str, set[str]]:
    """Return the packages that each package imports, at the top or late."""
    graph: dict[str, set[str]] = {package_of(module, sources): set() for module in sources}
    for each in found:
        importer, imported = package_of(each.importer, sources), package_of(each.imported, sources)
        if each.kind != TYPING and importer != imported:
            graph[importer].add(imported)
    return graph


def cycles(graph: Mapping[str, Set[str]]) -> list[set[str]]:
    """Return the strongly connected components with two or more names, which are the import cycles."""
    rest = {name: set(followers) for name, followers in graph.items()}
    while ends := [name for name, followers in rest.items() if not followers & rest.keys()]:  # they are on no cycle
        for name in ends:
            del rest[name]
    reached = {start: _reached(start, rest) for start in rest}
    found = {frozenset(other for other in reach if start in reached.get(other, ())) for start, reach in reached.items()}
    return sorted((set(names) for names in found if len(names) > 1), key=sorted)


def _reached(start: str, graph: Mapping[str, Set[str]]) -> set[str]:
    reached: set[str] = set()
    waiting = [start]
    while waiting:
        for name in graph.get(waiting.pop(), ()):
            if name not in reached:
                reached.add(name)
                waiting.append(name)
    return reached
