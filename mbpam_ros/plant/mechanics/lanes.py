"""Four numbers at once, one of each finger: compiled, a register of vectors; in Python, an array of shape (4,).

Whatever is the same for all fingers is computed in lanes, in the order of the operations that one alone would take: a
lane has the same bits, whatever the others hold. Arrays of lanes have the fingers as their last axis, of length
:data:`WIDTH`; where there are fewer fingers, lanes are left idle.

Compilers find such vectors by themselves only where no two arrays may overlap. Here they are written down, by numba's
public means for types of one's own.
"""

from __future__ import annotations

import operator
from collections.abc import Callable

import numpy as np
from llvmlite import ir
from numba.core import types
from numba.core.base import BaseContext
from numba.core.typing import Context, Signature, signature
from numba.extending import lower_builtin, models, register_model, type_callable
from numba.np.arrayobj import make_array

from mbpam_ros.plant.mechanics.vectors import Array

WIDTH = 4
"""Lanes of a register, and the most fingers."""

Lanes = Array
LaneVector = tuple[Lanes, Lanes, Lanes]
Place = tuple[int, ...]


def load(values: Array, place: Place) -> Lanes:
    """Return the lanes at a place of an array (..., 4)."""
    lanes: Lanes = values[place].copy()
    return lanes


def store(values: Array, place: Place, lanes: Lanes) -> None:
    """Write the lanes at a place of an array (..., 4)."""
    values[place] = lanes


def splat(value: float) -> Lanes:
    """Return the number in all lanes."""
    return np.full(WIDTH, value)


def lane(lanes: Lanes, place: int) -> float:
    """Return one of the lanes."""
    value: float = lanes[place]
    return value


def with_lane(lanes: Lanes, place: int, value: float) -> Lanes:
    """Return the lanes with another number in one of them."""
    changed = lanes.copy()
    changed[place] = value
    return changed


def any_above(lanes: Lanes, limit: float) -> bool:
    """Return whether any lane is above the limit."""
    return bool((lanes > limit).any())


def all_above(lanes: Lanes, limit: float) -> bool:
    """Return whether all lanes are above the limit."""
    return bool((lanes > limit).all())


class _LanesType(types.Type):
    def __init__(self) -> None:
        super().__init__(name="lanes")


_LANES = _LanesType()
_VECTOR, _INDEX, _OFFSET = ir.VectorType(ir.DoubleType(), WIDTH), ir.IntType(32), ir.IntType(64)
_ALIGNMENT = 8
"""Of arrays of numpy, bytes."""


@register_model(_LanesType)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: object, kind: types.Type) -> None:
        super().__init__(manager, kind, _VECTOR)


def _typed(function: Callable[..., object], answer: Callable[..., types.Type | Signature | None]) -> None:
    """Let compiled code call the function where the types of its arguments have an answer, which is its own type."""

    @type_callable(function)
    def _(_: Context) -> Callable[..., types.Type | Signature | None]:
        return answer


def _splat(builder: ir.IRBuilder, value: ir.Value) -> ir.Value:
    one = builder.insert_element(ir.Constant(_VECTOR, ir.Undefined), value, _INDEX(0))
    return builder.shuffle_vector(one, one, ir.Constant(ir.VectorType(_INDEX, WIDTH), [0] * WIDTH))


def _arithmetic(function: Callable[..., object], instruction: str) -> None:
    """Let compiled code do it with lanes, and with lanes and a number."""
    pairs = ((_LANES, _LANES), (_LANES, types.float64), (types.float64, _LANES))
    _typed(function, lambda one, other: _LANES if (one, other) in pairs else None)

    def generate(_: BaseContext, builder: ir.IRBuilder, kinds: Signature, values: list[ir.Value]) -> ir.Value:
        lanes = [v if kind == _LANES else _splat(builder, v) for v, kind in zip(values, kinds.args, strict=True)]
        return getattr(builder, instruction)(*lanes)

    for pair in pairs:
        lower_builtin(function, *pair)(generate)


for _function, _instruction in (
    (operator.add, "fadd"),
    (operator.sub, "fsub"),
    (operator.mul, "fmul"),
    (operator.truediv, "fdiv"),
):
    _arithmetic(_function, _instruction)

_typed(operator.neg, lambda lanes: _LANES if lanes == _LANES else None)


@lower_builtin(operator.neg, _LANES)
def _negative(_: BaseContext, builder: ir.IRBuilder, __: Signature, values: list[ir.Value]) -> ir.Value:
    return builder.fneg(values[0])


def _placed(values: types.Type, place: types.Type) -> types.Type | None:
    """Return the type of places in arrays of lanes of such a type; none of what is no such array or place."""
    if not (isinstance(values, types.Array) and (values.layout, values.dtype) == ("C", types.float64)):
        return None
    axes: int = values.ndim - 1
    return types.UniTuple(types.intp, axes) if isinstance(place, types.BaseTuple) and len(place) == axes else None


def _load_type(values: types.Type, place: types.Type) -> Signature | None:
    placed = _placed(values, place)
    return None if placed is None else signature(_LANES, values, placed)


def _store_type(values: types.Type, place: types.Type, lanes: types.Type) -> Signature | None:
    placed = _placed(values, place)
    return None if placed is None or lanes != _LANES else signature(types.void, values, placed, lanes)


_typed(load, _load_type)
_typed(store, _store_type)
_typed(splat, lambda value: signature(_LANES, types.float64) if isinstance(value, types.Number) else None)
_typed(lane, lambda lanes, place: signature(types.float64, _LANES, types.intp))
_typed(with_lane, lambda lanes, place, value: signature(_LANES, _LANES, types.intp, types.float64))
for _question in (any_above, all_above):
    _typed(_question, lambda lanes, limit: signature(types.boolean, _LANES, types.float64))


def _address(
    context: BaseContext, builder: ir.IRBuilder, kind: types.Array, values: ir.Value, place: ir.Value
) -> ir.Value:
    """Return that of the lanes at a place; the compiler need not ask how long the last axis is."""
    array = make_array(kind)(context, builder, values)
    offset = _OFFSET(0)
    for axis in range(kind.ndim - 1):
        length, step = builder.extract_value(array.shape, axis), builder.extract_value(place, axis)
        offset = builder.add(builder.mul(offset, length), step)
    first = builder.gep(array.data, [builder.mul(offset, _OFFSET(WIDTH))])
    return builder.bitcast(first, _VECTOR.as_pointer())


@lower_builtin(load, types.Array, types.UniTuple)
def _load(context: BaseContext, builder: ir.IRBuilder, kinds: Signature, values: list[ir.Value]) -> ir.Value:
    return builder.load(_address(context, builder, kinds.args[0], *values), align=_ALIGNMENT)


@lower_builtin(store, types.Array, types.UniTuple, _LANES)
def _store(context: BaseContext, builder: ir.IRBuilder, kinds: Signature, values: list[ir.Value]) -> ir.Value:
    builder.store(values[2], _address(context, builder, kinds.args[0], *values[:2]), align=_ALIGNMENT)
    return context.get_dummy_value()


@lower_builtin(splat, types.float64)
def _splatted(_: BaseContext, builder: ir.IRBuilder, __: Signature, values: list[ir.Value]) -> ir.Value:
    return _splat(builder, values[0])


@lower_builtin(lane, _LANES, types.intp)
def _lane(_: BaseContext, builder: ir.IRBuilder, __: Signature, values: list[ir.Value]) -> ir.Value:
    return builder.extract_element(values[0], values[1])


@lower_builtin(with_lane, _LANES, types.intp, types.float64)
def _with_lane(_: BaseContext, builder: ir.IRBuilder, __: Signature, values: list[ir.Value]) -> ir.Value:
    return builder.insert_element(values[0], values[2], values[1])


def _above(builder: ir.IRBuilder, values: list[ir.Value]) -> ir.Value:
    """Return a bit for each lane."""
    above = builder.fcmp_ordered(">", values[0], _splat(builder, values[1]))
    return builder.bitcast(above, ir.IntType(WIDTH))


@lower_builtin(any_above, _LANES, types.float64)
def _any_above(_: BaseContext, builder: ir.IRBuilder, __: Signature, values: list[ir.Value]) -> ir.Value:
    bits = _above(builder, values)
    return builder.icmp_unsigned("!=", bits, bits.type(0))


@lower_builtin(all_above, _LANES, types.float64)
def _all_above(_: BaseContext, builder: ir.IRBuilder, __: Signature, values: list[ir.Value]) -> ir.Value:
    bits = _above(builder, values)
    return builder.icmp_unsigned("==", bits, bits.type(2**WIDTH - 1))
