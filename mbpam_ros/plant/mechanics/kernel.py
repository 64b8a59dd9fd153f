"""How the functions of the mechanics are compiled: no references to arrays are counted.

For sixty arrays that takes longer than a sub-step. The functions make no array, and keep none longer than their call;
numba refuses others when it compiles them. As the packing of arguments, this is done with the versions of numba that
were tried, and compiled as usual with any other.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from numba import njit

from mbpam_ros.plant.mechanics.packed_arguments import packs

if TYPE_CHECKING:
    kernel = njit
else:
    kernel = partial(njit, _nrt=False) if packs() else njit
