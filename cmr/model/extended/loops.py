"""Split a long sequence of statements into loops over robots, for instruction-level parallelism.

A step is a dependency chain of a thousand instructions. In short loops the processor overlaps robots, which halves the
time. Values used by later loops are stored in rows.

Each assignment gets a new name, and choices become calls of `select`: otherwise Numba would split the step into
hundreds of blocks and do the renaming itself, which takes twice as long.
"""

import ast
from collections import Counter
from collections.abc import Collection, Sequence


def loops(parts: Sequence[Sequence[str]], rows: Collection[str], kept: Collection[str]) -> tuple[list[str], list[str]]:
    """Return one loop per part, and the names that need rows besides `rows`.

    Loops run over `i` below `lanes`, on rows of an array `work`. `kept` are rows whose last value is needed.
    """
    reads, writes = zip(*(_names("\n".join(part)) for part in parts), strict=True)
    extra: list[str] = []
    lines: list[str] = []
    for k, part in enumerate(parts):
        before = set(rows).union(*writes[:k])
        later = set(kept).union(*reads[k + 1 :])
        stored = [name for name in writes[k] if name in later]
        extra += [name for name in stored if name not in rows and name not in extra]
        body = [
            *(f"{name} = work[{name.upper()} + i]" for name in reads[k] if name in before),
            *part,
            *(f"work[{name.upper()} + i] = {name}" for name in stored),
        ]
        lines += ["for i in range(lanes):", *("    " + line for line in _straight(body, k))]
    return lines, extra


def _straight(body: Sequence[str], part: int) -> list[str]:
    """Return equivalent statements without choices and without reassignments across all parts."""
    straight = _Straight(part)
    return [ast.unparse(straight.visit(statement)) for statement in ast.parse("\n".join(body)).body]


class _Straight(ast.NodeTransformer):
    """Rewrites the statements of one part in order."""

    def __init__(self, part: int) -> None:
        self._part = part
        self._newest: dict[str, str] = {}
        self._assigned: Counter[str] = Counter()

    def visit_Assign(self, node: ast.Assign) -> ast.Assign:
        """Visit the reads before the writes."""
        node.value = self.visit(node.value)
        node.targets = [self.visit(target) for target in node.targets]
        return node

    def visit_Name(self, node: ast.Name) -> ast.Name:
        """Give assigned variables new names, and use the newest for reads."""
        if isinstance(node.ctx, ast.Store):
            self._newest[node.id] = f"{node.id}__{self._part}_{self._assigned[node.id]}"
            self._assigned[node.id] += 1
        return ast.Name(self._newest.get(node.id, node.id), node.ctx)

    def visit_IfExp(self, node: ast.IfExp) -> ast.Call:
        """Return a call of `select`."""
        self.generic_visit(node)
        return ast.Call(ast.Name("select", ast.Load()), [node.test, node.body, node.orelse], [])


def _names(code: str) -> tuple[list[str], list[str]]:
    """Return the names read before their assignment, and the assigned names, in order."""
    reads: dict[str, None] = {}
    writes: dict[str, None] = {}
    for statement in ast.parse(code).body:
        names = [node for node in ast.walk(statement) if isinstance(node, ast.Name)]
        reads.update({node.id: None for node in names if isinstance(node.ctx, ast.Load) and node.id not in writes})
        writes.update({node.id: None for node in names if isinstance(node.ctx, ast.Store)})
    return list(reads), list(writes)
