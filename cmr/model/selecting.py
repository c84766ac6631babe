"""A choice between two numbers that is an instruction and no branch, in compiled code."""

from typing import TYPE_CHECKING, Any

from numba.core import types
from numba.extending import lower_builtin, type_callable

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from llvmlite.ir import Instruction, IRBuilder, Value
    from numba.core.base import BaseContext
    from numba.core.types import Type
    from numba.core.typing import Signature
    from numba.core.typing.context import Context as TypingContext

typed: Any = type_callable
lowered: Any = lower_builtin


def select(condition: bool, one: float, other: float) -> float:
    """Return one number where the condition holds, the other where it does not; both are computed before."""
    return one if condition else other


def _type(context: "TypingContext") -> "Callable[[Type, Type, Type], Type]":
    return lambda _condition, one, other: context.unify_types(one, other)


def _lower(
    context: "BaseContext", builder: "IRBuilder", signature: "Signature", values: "Sequence[Value]"
) -> "Instruction":
    wanted = (types.boolean, signature.return_type, signature.return_type)
    cast = (context.cast(builder, *each) for each in zip(values, signature.args, wanted, strict=True))
    return builder.select(*cast)


typed(select)(_type)
lowered(select, types.Any, types.Any, types.Any)(_lower)
