"""Statements of the model as C99, from Python's syntax tree. All variables are doubles, including truth values."""

import ast
import math
from collections.abc import Collection, Iterable
from textwrap import wrap

from cmr.model.extended.program import helpers

OPERATORS: dict[type, str] = {
    **{ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.BitAnd: "&&", ast.BitOr: "||"},
    **{ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!="},
}
# Function names in Python and in C. `floor`, `exp`, `expm1`, `sin`, `cos` and `sqrt` are the same.
NAMES = {"abs": "fabs", "min": "smaller", "max": "larger", "sincos": "sine_and_cosine"}
MATHEMATICS = {"exp", "expm1", "cos", "sin", "sqrt", "floor"}
SEVERAL = {"sincos": 2, "coefficients": 3}  # number of results of functions that return more than one
# min and max with Python's semantics: of two numbers that do not compare, the first.
OWN = """\
static double smaller(double one, double other) { return other < one ? other : one; }

static double larger(double one, double other) { return other > one ? other : one; }

static void sine_and_cosine(double angle, double *sine, double *cosine) {
    *sine = sin(angle);
    *cosine = cos(angle);
}
"""
RANDOM_NUMBER = """\
/* A number in [0, 1) that the four arguments fix (SplitMix64; Steele et al., OOPSLA 2014). */
static double random_number(uint64_t seed, uint64_t number, uint64_t robot, uint64_t stream) {
    uint64_t z = seed * 0x9E3779B97F4A7C15u + number * 0xD1B54A32D192ED03u;
    z = z + robot * 0xABC98388FB8FAC03u + stream * 0x8CB92BA72F3D8DD7u;
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
    z = z ^ (z >> 31);
    return (double)(z >> 12) / 4503599627370496.0;
}
"""


class NoCounterpartError(ValueError):
    """A statement has no equivalent in C."""


def c_lines(lines: Iterable[str]) -> list[str]:
    """Return assignments in Python as statements in C.

    Raises NoCounterpartError for anything but assignments, and for operations that effects do not use.
    """
    return [line for node in ast.parse("\n".join(lines)).body for line in _statement(node)]


def assigned(lines: Iterable[str]) -> list[str]:
    """Return the names that statements assign, in order."""
    nodes = (node for statement in ast.parse("\n".join(lines)).body for node in ast.walk(statement))
    return list(dict.fromkeys(n.id for n in nodes if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)))


def declared(names: Iterable[str]) -> list[str]:
    """Return the declarations of these variables, if any."""
    together = ", ".join(names)
    return wrap(f"double {together};", 100, subsequent_indent="       ") if together else []


def c_functions(names: Collection[str]) -> str:
    """Return the definitions of those called functions that C does not have, including those named."""
    chosen = [_function(function) for name, function in helpers().items() if name in names and name != "random_number"]
    return "\n".join([OWN, *chosen, *([RANDOM_NUMBER] if "random_number" in names else [])])


def number(value: float) -> str:
    """Return a number as C writes it."""
    if math.isinf(value):
        return "INFINITY" if value > 0.0 else "(-INFINITY)"
    return repr(float(value)) if value >= 0.0 else f"({float(value)!r})"


def _statement(node: ast.stmt) -> list[str]:
    if not isinstance(node, ast.Assign) or len(node.targets) != 1:
        raise NoCounterpartError(f"no counterpart in C: {ast.unparse(node)}")
    target, value = node.targets[0], node.value
    if isinstance(target, ast.Name):
        return [f"{target.id} = {_expression(value)};"]
    if not isinstance(target, ast.Tuple):
        raise NoCounterpartError(f"no counterpart in C: {ast.unparse(node)}")
    names = [one.id for one in target.elts if isinstance(one, ast.Name)]
    if isinstance(value, ast.Call) and isinstance(value.func, ast.Name) and SEVERAL.get(value.func.id) == len(names):
        arguments = [*map(_expression, value.args), *(f"&{name}" for name in names)]
        return [f"{NAMES.get(value.func.id, value.func.id)}({', '.join(arguments)});"]
    if not isinstance(value, ast.Tuple) or len(value.elts) != len(names):
        raise NoCounterpartError(f"no counterpart in C: {ast.unparse(node)}")
    # All values are evaluated before the first assignment.
    kept = [f"double to_{name} = {_expression(one)};" for name, one in zip(names, value.elts, strict=True)]
    return ["{", *("    " + line for line in kept), *(f"    {name} = to_{name};" for name in names), "}"]


def _expression(node: ast.expr) -> str:
    match node:
        case ast.Constant(value=bool(value)):
            return "1.0" if value else "0.0"
        case ast.Constant(value=int() | float() as value):
            return number(value)
        case ast.Name(id=name):
            return {"inf": "INFINITY", "pi": number(math.pi)}.get(name, name)
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return f"(-{_expression(operand)})"
        case ast.BinOp(op=ast.Pow(), left=left, right=right):
            return f"pow({_expression(left)}, {_expression(right)})"
        case ast.BinOp(op=operator, left=left, right=right) if type(operator) in OPERATORS:
            return f"({_expression(left)} {OPERATORS[type(operator)]} {_expression(right)})"
        case ast.Compare(left=left, ops=[operator], comparators=[right]) if type(operator) in OPERATORS:
            return f"({_expression(left)} {OPERATORS[type(operator)]} {_expression(right)})"
        case ast.IfExp(test=test, body=body, orelse=otherwise):
            return f"({_expression(test)} ? {_expression(body)} : {_expression(otherwise)})"
        case ast.Call(func=ast.Name(id="random_number"), args=[seed, count, robot, ast.Constant(value=int(stream))]):
            return f"random_number({_expression(seed)}, {_expression(count)}, {_expression(robot)}, {stream}u)"
        case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]) if _is_known(name):
            return f"{NAMES.get(name, name)}({', '.join(map(_expression, arguments))})"
    raise NoCounterpartError(f"no counterpart in C: {ast.unparse(node)}")


def _is_known(name: str) -> bool:
    return name in MATHEMATICS or name in NAMES or name in helpers()


def _function(function: ast.FunctionDef) -> str:
    """Return one of the helpers in C; several results are written through its last arguments, which are pointers."""
    documentation, *body = function.body
    arguments = [f"double {argument.arg}" for argument in function.args.args]
    before, result = body[:-1], body[-1]
    if not isinstance(result, ast.Return) or result.value is None:
        raise NoCounterpartError(f"{function.name} does not end with a result")
    source = [ast.unparse(statement) for statement in before]
    lines = [*declared(assigned(source)), *c_lines(source)]
    if isinstance(result.value, ast.Tuple):
        kind = "void"
        arguments += [f"double *result_{number}" for number in range(len(result.value.elts))]
        lines += [f"*result_{number} = {_expression(one)};" for number, one in enumerate(result.value.elts)]
    else:
        kind = "double"
        lines.append(f"return {_expression(result.value)};")
    comment = ast.get_docstring(function) or ast.unparse(documentation)
    inside = "".join(f"    {line}\n" for line in lines)
    return f"/* {comment} */\nstatic {kind} {function.name}({', '.join(arguments)}) {{\n{inside}}}\n"
