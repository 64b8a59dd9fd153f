"""How the functions of the mechanics are compiled: into what calls them, and no references to arrays are counted.

A kernel is compiled where compiled code calls it, once for each set of types, without what Python would need to call
it: that takes a fifth of the time of a first start. Called from Python it is plain Python. What Python is to call
compiled is an entry.

The compiler goes through all that a function calls anew for each that calls it, and through one long function for much
longer than through its parts: few levels of functions of some length are compiled fastest. A level that only hands on
is put into its caller before types are found.

To count references takes longer for sixty arrays than a sub-step does. The functions make no array, and keep none
longer than their call; numba refuses others when it compiles them. As the packing of arguments, this is done with the
versions of numba that were tried, and compiled as usual with any other.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, TypeVar

from numba import njit
from numba.extending import register_jitable

from mbpam_ros.plant.mechanics.packed_arguments import packs

if TYPE_CHECKING:
    Function = TypeVar("Function", bound=Callable[..., object])
    entry = kernel = njit

    def piece(function: Function) -> Function:
        """Let compiled code take in a function whole."""

else:
    _UNCOUNTED = {"_nrt": False} if packs() else {}
    entry = partial(njit, no_cfunc_wrapper=True, **_UNCOUNTED)

    def kernel(function=None, **options):  # noqa: ANN201  # as njit, which type checkers see
        """Let compiled code call a function; ``inline="always"`` makes it a part of that before types are found."""
        if function is None:
            return partial(kernel, **options)
        if options.get("inline") == "always":
            return entry(**options)(function)
        compiled = register_jitable(no_cfunc_wrapper=True, **_UNCOUNTED, **options)(function)
        compiled.py_func = function  # as what numba has compiled
        return compiled

    piece = partial(kernel, forceinline=True)
