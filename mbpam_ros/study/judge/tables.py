"""What tables look like: procedural textures, in two sets that share no kind.

A detector is tuned on one set and reported on the other, so that no table of the report has been seen before.
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

TEXTURE_PX = 1024
TEXTURE_SIDE_M = 0.6
"""Side of the square of table that one texture covers."""

Texture = Callable[[np.random.Generator], NDArray[np.float64]]


def _cloud(rng: np.random.Generator, grain_px: float, stretch: float = 1.0) -> NDArray[np.float64]:
    """Smooth noise of zero mean and unit variance, ``stretch`` times longer along the columns."""
    small = max(int(TEXTURE_PX / grain_px), 2)
    rows = max(int(small / stretch), 2)
    noise = rng.standard_normal((rows, small)).astype(np.float32)
    big = cv2.resize(noise, (TEXTURE_PX, TEXTURE_PX), interpolation=cv2.INTER_CUBIC)
    return np.asarray((big - big.mean()) / (big.std() + 1e-9), dtype=float)


def _rgb(rng: np.random.Generator, low: float = 0.15, high: float = 0.85, chroma: float = 0.15) -> NDArray[np.float64]:
    return np.clip(rng.uniform(low, high) + chroma * rng.uniform(-1.0, 1.0, 3), 0.05, 0.95)


def _wood_rgb(rng: np.random.Generator) -> NDArray[np.float64]:
    return np.array([0.62, 0.45, 0.28]) * rng.uniform(0.55, 1.35)


def _between(a: NDArray, b: NDArray, share: NDArray) -> NDArray[np.float64]:
    share = np.clip(share, 0.0, 1.0)[..., None]
    return a * (1.0 - share) + b * share


def _plain(rng: np.random.Generator) -> NDArray[np.float64]:
    return _rgb(rng) * (1.0 + 0.02 * _cloud(rng, 4.0))[..., None]


def _wood(rng: np.random.Generator) -> NDArray[np.float64]:
    v, u = np.mgrid[0:TEXTURE_PX, 0:TEXTURE_PX] / TEXTURE_PX
    rings = np.sin(2.0 * np.pi * (rng.uniform(6.0, 18.0) * u + 0.5 * _cloud(rng, 200.0, 4.0)))
    fibre = _cloud(rng, 3.0, 20.0)
    return _wood_rgb(rng) * (1.0 + 0.10 * rings + 0.05 * fibre)[..., None]


def _speckle(rng: np.random.Generator) -> NDArray[np.float64]:
    base, spot = _rgb(rng), _rgb(rng)
    return _between(base, spot, (_cloud(rng, rng.uniform(3.0, 7.0)) - 0.9) * 2.0)


def _weave(rng: np.random.Generator) -> NDArray[np.float64]:
    v, u = np.mgrid[0:TEXTURE_PX, 0:TEXTURE_PX]
    period = rng.uniform(5.0, 10.0)
    threads = np.sin(2.0 * np.pi * u / period) * np.sin(2.0 * np.pi * v / period)
    return _rgb(rng) * (1.0 + 0.12 * threads + 0.03 * _cloud(rng, 3.0))[..., None]


def _marble(rng: np.random.Generator) -> NDArray[np.float64]:
    field = _cloud(rng, 160.0) + 0.5 * _cloud(rng, 70.0) + 0.25 * _cloud(rng, 30.0)
    return _between(_rgb(rng, 0.55, 0.9, 0.05), _rgb(rng, 0.3, 0.6, 0.05), np.exp(-8.0 * np.abs(field)))


def _stripes(rng: np.random.Generator) -> NDArray[np.float64]:
    _, u = np.mgrid[0:TEXTURE_PX, 0:TEXTURE_PX]
    share = (np.sin(2.0 * np.pi * u / rng.uniform(40.0, 130.0)) > rng.uniform(-0.5, 0.5)).astype(float)
    return _between(_rgb(rng), _rgb(rng), cv2.GaussianBlur(share, (0, 0), 1.5))


def _checks(rng: np.random.Generator) -> NDArray[np.float64]:
    v, u = np.mgrid[0:TEXTURE_PX, 0:TEXTURE_PX]
    side = rng.uniform(20.0, 70.0)
    share = 0.5 * ((u // side) % 2) + 0.5 * ((v // side) % 2)
    return _between(_rgb(rng), _rgb(rng), cv2.GaussianBlur(share, (0, 0), 1.0))


def _planks(rng: np.random.Generator) -> NDArray[np.float64]:
    image = _wood(rng)
    width = rng.uniform(110.0, 260.0)
    for left in np.arange(0.0, TEXTURE_PX, width):
        a, b = int(left), int(min(left + width, TEXTURE_PX))
        image[:, a:b] *= rng.uniform(0.8, 1.2)
        image[:, a : a + 3] *= 0.5
    return image


def _tiles(rng: np.random.Generator) -> NDArray[np.float64]:
    side = int(rng.uniform(60.0, 180.0))
    image = np.empty((TEXTURE_PX, TEXTURE_PX, 3))
    base = _rgb(rng)
    for top in range(0, TEXTURE_PX, side):
        for left in range(0, TEXTURE_PX, side):
            image[top : top + side, left : left + side] = base * rng.uniform(0.9, 1.1)
    image[::side], image[1::side], image[:, ::side], image[:, 1::side] = (base * 0.6,) * 4
    return image * (1.0 + 0.02 * _cloud(rng, 5.0))[..., None]


def _print(rng: np.random.Generator) -> NDArray[np.float64]:
    """Lines of print on paper."""
    image = np.full((TEXTURE_PX, TEXTURE_PX), 0.85)
    for top in range(20, TEXTURE_PX, int(rng.uniform(18.0, 34.0))):
        left = 10.0
        while left < TEXTURE_PX:
            word = rng.uniform(8.0, 50.0)
            image[top : top + 6, int(left) : int(left + word)] = 0.3
            left += word + 8.0
    return image[..., None] * np.array([1.0, 0.98, 0.93])


def _stains(rng: np.random.Generator) -> NDArray[np.float64]:
    return _between(_rgb(rng), _rgb(rng, chroma=0.08), 0.5 * (_cloud(rng, 90.0) - 0.4))


def _steel(rng: np.random.Generator) -> NDArray[np.float64]:
    return np.full(3, rng.uniform(0.35, 0.7)) * (1.0 + 0.06 * _cloud(rng, 2.5, 60.0))[..., None]


TUNING: dict[str, Texture] = {
    "plain": _plain,
    "wood": _wood,
    "speckle": _speckle,
    "weave": _weave,
    "stripes": _stripes,
    "stains": _stains,
}
REPORT: dict[str, Texture] = {
    "mat": lambda rng: _rgb(rng, 0.1, 0.5, 0.2) * (1.0 + 0.04 * _cloud(rng, 8.0))[..., None],
    "planks": _planks,
    "marble": _marble,
    "checks": _checks,
    "tiles": _tiles,
    "print": _print,
    "steel": _steel,
}


def texture(tables: dict[str, Texture], kind: str, rng: np.random.Generator) -> NDArray[np.uint8]:
    """One table of a kind, (TEXTURE_PX, TEXTURE_PX, 3) rgb8."""
    return np.clip(255.0 * tables[kind](rng), 0.0, 255.0).astype(np.uint8)
