"""A choice between two numbers that is an instruction and no branch, in compiled code."""

from typing import Any

from numba.core import types
from numba.extending import lower_builtin, type_callable

typed: Any = type_callable
lowered: Any = lower_builtin


def select(condition: bool, one: float, other: float) -> float:
    """Return one number where the condition holds, the other where it does not; both are computed before."""
    return one if condition else other


def _type(context: Any) -> Any:
    return lambda _condition, one, other: context.unify_types(one, other)


def _lower(context: Any, builder: Any, signature: Any, values: Any) -> Any:
    wanted = (types.boolean, signature.return_type, signature.return_type)
    cast = (context.cast(builder, *each) for each in zip(values, signature.args, wanted, strict=True))
    return builder.select(*cast)


typed(select)(_type)
lowered(select, types.Any, types.Any, types.Any)(_lower)
