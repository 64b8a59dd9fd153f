"""The tip force a muscle has against a plate that blocks it, at any intrinsic moment.

PSC and PDC have it from the blocked rod (:mod:`~mbpam_ros.actuator.blocked_rod`), as a lever: force over |M0|, which
changes by some 20 % over the pressure. Between the eight directions, at azimuth phi of M0, the two levers k are mixed,

    F = |M0| (k_D(|M0|) cos^2(2 phi) + k_S(|M0|) sin^2(2 phi)),

which returns both patterns exactly, turns and mirrors with M0 and is continuous. The mixture is an assumption.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True, eq=False)
class TipForce:
    """Blocked force over intrinsic moment, at rising moments. Beyond the tables the lever is constant.

    Args:
        psc_moment_n_m, pdc_moment_n_m: |M0| > 0, rising, shape (n,).
        psc_force_n, pdc_force_n: blocked force there, shape (n,).

    Raises:
        ValueError: a table does not rise, or its two columns differ in length.
    """

    psc_moment_n_m: NDArray[np.float64]
    psc_force_n: NDArray[np.float64]
    pdc_moment_n_m: NDArray[np.float64]
    pdc_force_n: NDArray[np.float64]

    def __post_init__(self) -> None:
        for pattern in ("psc", "pdc"):
            moment, force = getattr(self, f"{pattern}_moment_n_m"), getattr(self, f"{pattern}_force_n")
            if moment.shape != force.shape or moment[0] <= 0.0 or np.any(np.diff(moment) <= 0.0):
                raise ValueError(f"{pattern}: one force for each of rising, positive moments is needed")

    @cached_property
    def _psc_lever(self) -> NDArray[np.float64]:
        return self.psc_force_n / self.psc_moment_n_m

    @cached_property
    def _pdc_lever(self) -> NDArray[np.float64]:
        return self.pdc_force_n / self.pdc_moment_n_m

    def at(self, moment_n_m: ArrayLike) -> NDArray[np.float64]:
        """Return the force [N], shape (...), for intrinsic moments in bend components, shape (..., 2)."""
        moment = np.asarray(moment_n_m, dtype=float)
        size = np.hypot(moment[..., 0], moment[..., 1])
        toward = np.divide(moment, size[..., None], out=np.zeros_like(moment), where=size[..., None] > 0.0)
        share = toward[..., 0] ** 2 - toward[..., 1] ** 2  # cos(2 phi)
        pdc = np.interp(size, self.pdc_moment_n_m, self._pdc_lever)
        psc = np.interp(size, self.psc_moment_n_m, self._psc_lever)
        force: NDArray[np.float64] = size * (psc + share**2 * (pdc - psc))
        return force
