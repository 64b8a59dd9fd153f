"""The least pressure that holds: a grid of pressures, then bisection at the lowest one of them that holds.

The grid comes first because holding need not grow with pressure: fingers that bend further may miss what they held.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class LeastPressure:
    """What a search found.

    Args:
        holds_pa: least pressure that was seen to hold; none where no pressure of the grid does.
        fails_pa: greatest pressure below it that was seen to fail; none where all do or the whole grid holds.
        gaps_pa: pressures of the grid above ``holds_pa`` that do not hold.
    """

    holds_pa: float | None
    fails_pa: float | None
    gaps_pa: tuple[float, ...]


def least_pressure(holds: Callable[[float], bool], grid_pa: Sequence[float], resolution_pa: float) -> LeastPressure:
    """Search a rising grid of pressures, then between its lowest one that holds and the one below it.

    Args:
        holds: whether a pressure [Pa gauge] holds.
        grid_pa: rising.
        resolution_pa: greatest distance of ``fails_pa`` to ``holds_pa``.

    Raises:
        ValueError: a grid that is empty or does not rise, or no resolution.
    """
    if not grid_pa or any(low >= high for low, high in zip(grid_pa, grid_pa[1:], strict=False)):
        raise ValueError(f"grid_pa must rise, found {list(grid_pa)}")
    if not resolution_pa > 0.0:
        raise ValueError(f"resolution_pa must be greater than 0, found {resolution_pa:g}")
    held = [holds(pressure) for pressure in grid_pa]
    if not any(held):
        return LeastPressure(None, None, ())
    first = held.index(True)
    gaps = tuple(pressure for pressure, ok in zip(grid_pa[first:], held[first:], strict=True) if not ok)
    high = grid_pa[first]
    if first == 0:
        return LeastPressure(high, None, gaps)
    low = grid_pa[first - 1]
    while high - low > resolution_pa:
        middle = 0.5 * (low + high)
        if holds(middle):
            high = middle
        else:
            low = middle
    return LeastPressure(high, low, gaps)
