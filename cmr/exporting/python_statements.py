"""Statements of the model as Python that runs without NumPy; division by zero gives infinity or NaN, as in NumPy."""

import ast
from collections.abc import Collection, Iterable, Mapping

from cmr.model.extended.program import helpers

ELEMENTARY = ("exp", "expm1", "cos", "sin", "sqrt", "floor", "inf", "pi")
# In place of those with NumPy's integers of 64 bits.
RANDOM_NUMBER = '''\
def random_number(seed, number, robot, stream):
    """Return a number in [0, 1) that the four arguments fix (SplitMix64; Steele et al., OOPSLA 2014)."""
    z = seed * 0x9E3779B97F4A7C15 + number * 0xD1B54A32D192ED03
    z = (z + robot * 0xABC98388FB8FAC03 + stream * 0x8CB92BA72F3D8DD7) & MASK
    z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & MASK
    z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & MASK
    z = z ^ (z >> 31)
    return (z >> 12) / 2**52
'''
SINCOS = '''\
def sincos(angle):
    """Return sine and cosine of an angle [rad]."""
    return sin(angle), cos(angle)
'''
DIVIDED = '''\
def divided(above, below):
    """Return a quotient as floating point has it: infinite, or not a number, where the divisor is zero."""
    if below:
        return above / below
    return above * inf if above else nan
'''
OWN = {"random_number": RANDOM_NUMBER, "sincos": SINCOS, "divided": DIVIDED}


def safe(lines: Iterable[str], never_zero: Collection[str]) -> list[str]:
    """Return statements that do not raise on division by zero; divisions by the names `never_zero` are not changed."""
    divide = _Divide(never_zero)
    return [ast.unparse(ast.fix_missing_locations(divide.visit(node))) for node in ast.parse("\n".join(lines)).body]


def called(lines: Iterable[str]) -> set[str]:
    """Return the names that statements read, including functions."""
    return {
        node.id
        for node in ast.walk(ast.parse("\n".join(lines)))
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load)
    }


def functions(names: Collection[str]) -> list[str]:
    """Return the sources of the functions with these names, and of those that they call, in order."""
    known = dict.fromkeys((*OWN, *helpers()))
    sources: dict[str, str] = {}
    waiting = [name for name in known if name in names]
    while waiting:
        name = waiting.pop(0)
        if name not in sources:
            sources[name] = OWN.get(name) or _plain(helpers()[name])
            waiting += [other for other in known if other in called([sources[name]])]
    return [sources[name] for name in known if name in sources]


def _plain(function: ast.FunctionDef) -> str:
    """Return a function without annotations that does not raise on division by zero."""
    bare = ast.parse(ast.unparse(function)).body[0]
    assert isinstance(bare, ast.FunctionDef), "it was one"
    bare.returns = None
    for argument in bare.args.args:
        argument.annotation = None
    return ast.unparse(ast.fix_missing_locations(_Divide(("dt", "rate")).visit(bare))) + "\n"


class _Divide(ast.NodeTransformer):
    """Calls `divided` for every quotient whose divisor may be zero."""

    def __init__(self, never_zero: Collection[str]) -> None:
        self._never_zero = {*never_zero, "dt"}

    def visit_BinOp(self, node: ast.BinOp) -> ast.expr:
        """Replace a division, after those inside it."""
        self.generic_visit(node)
        if not isinstance(node.op, ast.Div) or self._is_safe(node.right):
            return node
        return ast.Call(ast.Name("divided", ast.Load()), [node.left, node.right], [])

    def _is_safe(self, node: ast.expr) -> bool:
        if isinstance(node, ast.Constant):
            return bool(node.value)
        if isinstance(node, ast.BinOp) and isinstance(node.op, (ast.Mult, ast.Div)):
            return self._is_safe(node.left) and self._is_safe(node.right)
        return isinstance(node, ast.Name) and node.id in self._never_zero


def indented(lines: Iterable[str], by: int = 8) -> str:
    """Return lines with an indentation."""
    return "".join(" " * by + line + "\n" for text in lines for line in text.splitlines())


def filled(template: str, parts: Mapping[str, str]) -> str:
    """Return a template in which each line that is a part's name in capitals is replaced by the part."""
    return "".join(parts.get(line.strip(), line) for line in template.splitlines(keepends=True))
