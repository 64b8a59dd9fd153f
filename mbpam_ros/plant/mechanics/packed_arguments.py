"""Tuples of arrays behind one address, for compiled code that is called often.

To pass sixty arrays one by one takes several times as long as a sub-step does, and as long again in the compiler. Here
they are written once into a block of memory, as compiled code holds them. A call passes the address of the block, and
so do compiled functions among each other: what is read from a block is a *reference*, which has the attributes of the
tuple. A tuple in it is a reference again; an array or a number is loaded from the block where it is used, and the
compiler is told that blocks do not change, so that it need not load anything twice. Whoever made the arrays keeps them
as long as the block is used; no references are counted.

This is numba's inside, of which no version promises anything: 0.59 to 0.68 have been tried. With any other, and without
the compiler, the block is the tuple itself and is passed as such: the same results, later.
"""

from __future__ import annotations

import functools
import zlib
from collections.abc import Callable
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba import njit, typeof
from numba.core import cgutils, config, types
from numba.core.base import BaseContext
from numba.core.typing import Signature
from numba.core.typing.templates import AttributeTemplate
from numba.extending import infer_getattr, intrinsic, lower_getattr_generic, models, register_model
from numba.np.arrayobj import make_array
from numpy.typing import NDArray

OLDEST_NUMBA, NEWEST_NUMBA = (0, 59), (0, 68)
"""Versions of which tuples are packed."""

Parts = tuple[Any, ...]
Block = NDArray[np.uint8] | Parts


def packs(version: tuple[int, int] = numba.version_info.short) -> bool:
    """Return whether tuples are packed with this version of numba, and its compiler is not switched off."""
    return OLDEST_NUMBA <= version <= NEWEST_NUMBA and not config.DISABLE_JIT  # type: ignore[attr-defined]  # from the environment


def new_block(parts: Parts, sample: Parts, packed: bool = packs()) -> Block:
    """Return a block with the parts; where they are not packed, the parts.

    Args:
        parts: of the types of the sample.
        sample: what :func:`access` was given.
        packed: whether they are packed.

    Raises:
        TypeError: a part is of another type than in the sample, or an array is not contiguous.
    """
    if not packed:
        return parts
    if _kinds(parts) != _kinds(sample):
        raise TypeError("parts are not of the types, and arrays not of the axes, that compiled code reads")
    block = np.zeros(1, _layout(parts))
    block[0] = _content(parts)
    return block.view(np.uint8)


def _layout(part: object) -> np.dtype[Any]:
    """Return how compiled code holds a part: as a structure in C."""
    return _layout_of(_kinds(part))


@functools.lru_cache(maxsize=1024)
def _layout_of(kinds: Any) -> np.dtype[Any]:
    if not isinstance(kinds, tuple):
        number: np.dtype[Any] = np.dtype(kinds)
        return number
    _, inner = kinds
    if isinstance(inner, tuple):
        return np.dtype([(f"f{place}", _layout_of(each)) for place, each in enumerate(inner)], align=True)
    return np.dtype([*_ARRAY_FIELDS, ("shape", np.int64, (inner,)), ("strides", np.int64, (inner,))], align=True)


def _kinds(part: object) -> Any:
    """Return what must agree for the same compiled code to read a part."""
    if isinstance(part, tuple):
        return type(part), tuple(map(_kinds, part))
    return (part.dtype, part.ndim) if isinstance(part, np.ndarray) else type(part)


def _content(part: Any) -> Any:
    if isinstance(part, tuple):
        return tuple(map(_content, part))
    if isinstance(part, np.ndarray):
        if not part.flags.c_contiguous:
            raise TypeError(f"an array of shape {part.shape} is not contiguous, and cannot be packed")
        return 0, 0, part.size, part.itemsize, part.ctypes.data, part.shape, part.strides
    return part


_ARRAY_FIELDS = [(name, np.int64) for name in ("meminfo", "parent", "nitems", "itemsize", "data")]


class _Reference(types.Type):
    """Where a tuple of type ``kind`` stands."""

    def __init__(self, kind: Any) -> None:
        self.kind: Any = kind
        self.parts: tuple[types.Type, ...] = tuple(kind)
        super().__init__(f"{kind.instance_class.__name__}@{zlib.crc32(str(kind).encode()):08x}")


@register_model(_Reference)
class _ReferenceModel(models.PrimitiveModel):
    def __init__(self, manager: object, kind: types.Type) -> None:
        super().__init__(manager, kind, _ADDRESS)


_ADDRESS = ir.IntType(8).as_pointer()


def _referred(kind: types.Type) -> types.Type:
    """Return the type of a part of what is referred to."""
    return _Reference(kind) if isinstance(kind, types.BaseNamedTuple) else kind


@infer_getattr
class _Attributes(AttributeTemplate):
    key = _Reference

    def generic_resolve(self, reference: _Reference, name: str) -> types.Type | None:  # type: ignore[override]
        fields = reference.kind.fields
        return _referred(reference.parts[fields.index(name)]) if name in fields else None


@lower_getattr_generic(_Reference)
def _attribute(context: BaseContext, builder: ir.IRBuilder, reference: _Reference, value: ir.Value, name: str) -> Any:
    place = reference.kind.fields.index(name)
    part = reference.parts[place]
    whole = builder.bitcast(value, context.get_data_type(reference.kind).as_pointer())
    address = _member(builder, whole, place)
    if isinstance(part, types.BaseNamedTuple):
        return builder.bitcast(address, _ADDRESS)
    if not isinstance(part, types.Array):
        return context.unpack_value(builder, part, address)
    array = make_array(part)(context, builder)
    for name, field in (("nitems", 2), ("itemsize", 3), ("data", 4)):
        setattr(array, name, _constant(builder, _member(builder, address, field)))
    for name, field in (("shape", 5), ("strides", 6)):
        numbers = _member(builder, address, field)
        axes = [_constant(builder, _member(builder, numbers, axis)) for axis in range(part.ndim)]
        setattr(array, name, cgutils.pack_array(builder, axes))
    for name in ("meminfo", "parent"):
        setattr(array, name, ir.Constant(getattr(array, name).type, None))
    return array._getvalue()


def _member(builder: ir.IRBuilder, address: ir.Value, place: int) -> ir.Value:
    return builder.gep(address, [ir.IntType(32)(0), ir.IntType(32)(place)], inbounds=True)


def _constant(builder: ir.IRBuilder, address: ir.Value) -> ir.Value:
    """Load what never changes."""
    value = builder.load(address)
    value.set_metadata("invariant.load", builder.module.add_metadata([]))
    return value


def access(sample: Parts, packed: bool = packs()) -> Callable[..., Any]:
    """Return what compiled code reads tuples of the type of the sample from blocks with."""
    if not packed:
        return _itself
    kind = typeof(sample)

    @intrinsic
    def read(_: object, block: types.Array) -> tuple[Signature, Callable[..., Any]]:
        def generate(context: BaseContext, builder: ir.IRBuilder, _: Signature, arguments: Parts) -> ir.Value:
            if context.get_abi_sizeof(context.get_data_type(kind)) != _layout(sample).itemsize:
                raise AssertionError("compiled code lays tuples out otherwise than C")
            return builder.bitcast(make_array(block)(context, builder, arguments[0]).data, _ADDRESS)

        return _Reference(kind)(block), generate

    return read


@njit
def _itself(block: Parts) -> Parts:
    return block
