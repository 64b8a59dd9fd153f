"""Tuples of arrays behind one address, for compiled code that is called often.

To pass sixty arrays one by one takes several times as long as a sub-step does. Here they are passed once: they are
written, as compiled code holds them, into a block of memory, and a call passes this block. Whoever made the arrays
keeps them as long as the block is used; no references are counted.

This is numba's inside, of which no version promises anything: 0.59 to 0.68 have been tried. With any other, and without
the compiler, the block is the tuple itself and is passed as such: the same results, later.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba import njit, typeof
from numba.core import config, types
from numba.core.base import BaseContext
from numba.core.typing import Signature
from numba.extending import intrinsic
from numba.np.arrayobj import make_array
from numpy.typing import NDArray

OLDEST_NUMBA, NEWEST_NUMBA = (0, 59), (0, 68)
"""Versions of which tuples are packed."""

Parts = tuple[Any, ...]
Block = NDArray[np.uint8] | Parts

_PER_ARRAY, _PER_NUMBER = 5 + 2 * 4, 1
"""The most words of eight bytes that an array, of up to four dimensions, and a number take."""


def packs(version: tuple[int, int] = numba.version_info.short) -> bool:
    """Return whether tuples are packed with this version of numba, and its compiler is not switched off."""
    return OLDEST_NUMBA <= version <= NEWEST_NUMBA and not config.DISABLE_JIT  # type: ignore[attr-defined]  # from the environment


def new_block(parts: Parts, packed: bool = packs()) -> Block:
    """Return a block with room for the parts; where they are not packed, the parts."""
    return np.zeros(8 * _words(parts), np.uint8) if packed else parts


def _words(part: object) -> int:
    if isinstance(part, tuple):
        return sum(map(_words, part))
    return _PER_ARRAY if isinstance(part, np.ndarray) else _PER_NUMBER


def access(sample: Parts, packed: bool = packs()) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """Return what compiled code writes tuples of the type of the sample into blocks with, and what it reads them with.

    Where tuples are packed, other types are refused when the code is compiled.
    """
    if not packed:
        return _nothing_to_write, _itself
    kind = typeof(sample)

    @intrinsic
    def write(_: object, block: types.Array, parts: types.Type) -> tuple[Signature, Callable[..., Any]] | None:
        if parts != kind:
            return None

        def generate(context: BaseContext, builder: ir.IRBuilder, _: Signature, arguments: Parts) -> ir.Value:
            place = _place(context, builder, kind, block, arguments[0])
            context.pack_value(builder, kind, _without_owners(context, builder, kind, arguments[1]), place)
            return context.get_dummy_value()

        return types.void(block, kind), generate

    @intrinsic
    def read(_: object, block: types.Array) -> tuple[Signature, Callable[..., Any]]:
        def generate(context: BaseContext, builder: ir.IRBuilder, _: Signature, arguments: Parts) -> ir.Value:
            return context.unpack_value(builder, kind, _place(context, builder, kind, block, arguments[0]))

        return kind(block), generate

    return write, read


@njit
def _nothing_to_write(block: Parts, parts: Parts) -> None:
    pass


@njit
def _itself(block: Parts) -> Parts:
    return block


def _place(
    context: BaseContext, builder: ir.IRBuilder, kind: types.Type, block: types.Array, value: ir.Value
) -> ir.Value:
    """Return the address of the block, as that of a tuple."""
    address = make_array(block)(context, builder, value).data
    return builder.bitcast(address, context.get_data_type(kind).as_pointer())


def _without_owners(context: BaseContext, builder: ir.IRBuilder, kind: types.Type, value: ir.Value) -> ir.Value:
    """Return the value with the owners of all its arrays left out."""
    if isinstance(kind, types.Array):
        array = make_array(kind)(context, builder, value)
        array.meminfo = ir.Constant(array.meminfo.type, None)
        array.parent = ir.Constant(array.parent.type, None)
        return array._getvalue()
    if isinstance(kind, (types.Tuple, types.UniTuple, types.NamedTuple, types.NamedUniTuple)):
        for place, part in enumerate(kind):
            bare = _without_owners(context, builder, part, builder.extract_value(value, place))
            value = builder.insert_value(value, bare, place)
    return value
