"""Cut a long sequence of statements into loops over robots, short enough for a processor to look ahead.

A step is a chain of a thousand instructions, each waiting for the one before. In short loops the processor works on
the next robots meanwhile, which halves the time. What a later part reads of an earlier one is kept in rows.

Each assignment gets a name of its own, and choices become calls of `select`: else Numba would divide the step into
hundreds of blocks and rename the variables itself, for which it takes twice as long.
"""

import ast
from collections import Counter
from collections.abc import Collection, Sequence


def loops(parts: Sequence[Sequence[str]], rows: Collection[str], kept: Collection[str]) -> tuple[list[str], list[str]]:
    """Return one loop for each part, and the names that need rows besides `rows`.

    Loops run over `i` below `lanes`, on rows of an array `work`. `kept` are the rows that must hold their last value.
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
    """Return statements that do the same without choices, and without assigning a name twice in all parts."""
    straight = _Straight(part)
    return [ast.unparse(straight.visit(statement)) for statement in ast.parse("\n".join(body)).body]


class _Straight(ast.NodeTransformer):
    """Visits the statements of one part in their order."""

    def __init__(self, part: int) -> None:
        self._part = part
        self._newest: dict[str, str] = {}
        self._assigned: Counter[str] = Counter()

    def visit_Assign(self, node: ast.Assign) -> ast.Assign:
        """Visit what is read before what is written."""
        node.value = self.visit(node.value)
        node.targets = [self.visit(target) for target in node.targets]
        return node

    def visit_Name(self, node: ast.Name) -> ast.Name:
        """Give what is assigned a new name, and what is read the newest."""
        if isinstance(node.ctx, ast.Store):
            self._newest[node.id] = f"{node.id}__{self._part}_{self._assigned[node.id]}"
            self._assigned[node.id] += 1
        return ast.Name(self._newest.get(node.id, node.id), node.ctx)

    def visit_IfExp(self, node: ast.IfExp) -> ast.Call:
        """Return a call that chooses."""
        self.generic_visit(node)
        return ast.Call(ast.Name("select", ast.Load()), [node.test, node.body, node.orelse], [])


def _names(code: str) -> tuple[list[str], list[str]]:
    """Return the names that statements read before they assign them, and those that they assign, in order."""
    reads: dict[str, None] = {}
    writes: dict[str, None] = {}
    for statement in ast.parse(code).body:
        names = [node for node in ast.walk(statement) if isinstance(node, ast.Name)]
        reads.update({node.id: None for node in names if isinstance(node.ctx, ast.Load) and node.id not in writes})
        writes.update({node.id: None for node in names if isinstance(node.ctx, ast.Store)})
    return list(reads), list(writes)
