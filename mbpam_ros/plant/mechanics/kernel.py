"""How the functions of the mechanics are compiled: no references to arrays are counted.

For sixty arrays that takes longer than a sub-step. The functions make no array, and keep none longer than their call;
numba refuses others when it compiles them. As the packing of arguments, this is done with the versions of numba that
were tried, and compiled as usual with any other.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, TypeVar

from numba import njit
from numba.extending import register_jitable

from mbpam_ros.plant.mechanics.packed_arguments import packs

Function = TypeVar("Function", bound=Callable[..., object])

if TYPE_CHECKING:
    kernel = njit
else:
    kernel = partial(njit, _nrt=False) if packs() else njit


def piece(function: Function) -> Function:
    """Let kernels call a function that they take in whole; in Python it stays what it is."""
    options = {"_nrt": False} if packs() else {}
    return register_jitable(forceinline=True, **options)(function)
