"""Design of a muscle and the domain in which the paper's data speak about it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mbpam_ros.configuration import require_positive
from mbpam_ros.errors import MbpamError

MetamodelName = Literal["prs", "rbf", "krg", "rbf_gaussian", "krg_nugget"]
"""Keys of :data:`~mbpam_ros.actuator.metamodel.METAMODELS`."""

YIELDING_SHARE = 0.3
"""Of each end's length that goes to the active part of the rod that stands for a muscle."""

SAME_DESIGN_SHARE = 1e-4
"""Share of a variable's range; designs that differ by no more than that in a and in b are the same design.

On the paper's domain 0.2 um, below what meshes and moulds tell apart; the designs of ``mbpam sample``, rounded to
1 um, differ by more."""


class DesignDomainError(MbpamError, ValueError):
    """The design lies outside the samples of its metamodel, which may not be asked there."""


@dataclass(frozen=True)
class DesignDomain:
    """Box of designs (a, b) in which samples speak; metamodels refuse to extrapolate out of it.

    Args:
        a_range_mm, b_range_mm: least and greatest value of each variable [mm].

    Raises:
        DesignDomainError: a range is empty or not finite.
    """

    a_range_mm: tuple[float, float]
    b_range_mm: tuple[float, float]

    def __post_init__(self) -> None:
        for name, (low, high) in (("a", self.a_range_mm), ("b", self.b_range_mm)):
            if not (np.isfinite([low, high]).all() and low < high):
                raise DesignDomainError(f"no domain: {name} must span a range, found {low:g} to {high:g} mm")

    @classmethod
    def around(cls, design_mm: ArrayLike) -> DesignDomain:
        """Return the smallest domain that holds the rows (a, b) of ``design_mm``, shape (n, 2).

        Raises:
            DesignDomainError: the rows do not span a range in both variables.
        """
        design = np.asarray(design_mm, dtype=float)
        low, high = design.min(axis=0), design.max(axis=0)
        return cls((float(low[0]), float(high[0])), (float(low[1]), float(high[1])))

    @property
    def bounds_mm(self) -> NDArray[np.float64]:
        """Rows low and high, columns a and b [mm]."""
        return np.array([self.a_range_mm, self.b_range_mm]).T

    def require_inside(self, design_mm: ArrayLike) -> None:
        """Check rows (a, b), shape (n, 2).

        Raises:
            DesignDomainError: a row lies outside or is not a number. The message names the nearest design inside.
        """
        design = np.asarray(design_mm, dtype=float)
        low, high = self.bounds_mm
        outside = ~np.all((low <= design) & (design <= high), axis=1)
        if not outside.any():
            return
        found = design[np.argmax(outside)]
        message = (
            f"design a = {found[0]:g} mm, b = {found[1]:g} mm is outside the sampled domain "
            f"{low[0]:g} <= a <= {high[0]:g} mm, {low[1]:g} <= b <= {high[1]:g} mm"
        )
        if np.isfinite(found).all():
            nearest = np.clip(found, low, high)
            message += f"; the nearest design inside is a = {nearest[0]:g}, b = {nearest[1]:g} mm"
        raise DesignDomainError(message)

    def same(self, design_mm: ArrayLike, other_mm: ArrayLike) -> NDArray[np.bool_]:
        """Return which rows (a, b) are the same design as ``other_mm`` (:data:`SAME_DESIGN_SHARE`), shape (n,)."""
        low, high = self.bounds_mm
        apart = np.abs(np.asarray(design_mm, dtype=float) - np.asarray(other_mm, dtype=float))
        same: NDArray[np.bool_] = np.all(apart <= SAME_DESIGN_SHARE * (high - low), axis=-1)
        return same

    def scale(self, design_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        """Map the domain to [-1, 1]^2, so that one length serves a and b; rows (a, b), shape (n, 2)."""
        low, high = self.bounds_mm
        scaled: NDArray[np.float64] = 2.0 * (design_mm - low) / (high - low) - 1.0
        return scaled


PAPER_DOMAIN = DesignDomain(a_range_mm=(1.5, 3.5), b_range_mm=(1.0, 3.0))
"""Bounds of the paper's Eq. 11, which its samples fill."""


@dataclass(frozen=True)
class MuscleDesign:
    """The two design variables of the paper's optimisation (Eq. 11), in its millimetres.

    Args:
        a_mm: full peak-to-valley amplitude of the chamber wall's wave [mm], 1.5 to 3.5.
        b_mm: thickness of the cross-shaped base layer [mm], 1.0 to 3.0.

    Raises:
        DesignDomainError: outside the domain. The message names the nearest design inside.
    """

    a_mm: float
    b_mm: float

    def __post_init__(self) -> None:
        PAPER_DOMAIN.require_inside([[self.a_mm, self.b_mm]])


class DrawnDesign(MuscleDesign):
    """A design of a muscle with a drawing of its own, about which that muscle's own finite elements speak.

    Raises:
        ValueError: a length is not positive.
    """

    def __post_init__(self) -> None:
        require_positive(self, "a_mm", "b_mm")


INITIAL_DESIGN = MuscleDesign(a_mm=2.5, b_mm=2.0)
"""The paper's initial design, on which it measured; ``config/data/README.md`` says how it was found."""


@dataclass(frozen=True)
class MuscleGeometry:
    """What the paper holds fixed, and the mass along the muscle. SI units.

    Args:
        outer_radius_m: crest radius of the muscle.
        end_length_m: unwaved piece at each end; in a rod's geometry straight and rigid.
        active_length_m: waved length between the ends that bends; in a rod's geometry what stands for it.
        mass_per_length_kg_m: mean mass per length of active part and ends.
    """

    outer_radius_m: float
    end_length_m: float
    active_length_m: float
    mass_per_length_kg_m: float

    def __post_init__(self) -> None:
        require_positive(self, "outer_radius_m", "end_length_m", "active_length_m", "mass_per_length_kg_m")

    @property
    def length_m(self) -> float:
        """Length from clamp to tip [m]."""
        return self.active_length_m + 2.0 * self.end_length_m


def uniform_geometry(geometry: MuscleGeometry) -> MuscleGeometry:
    """Return the geometry of the uniform rod that stands for a muscle; it is as long, and as heavy.

    Its law, and where the share comes from: :mod:`~mbpam_ros.actuator.yielding_ends`.
    """
    given = YIELDING_SHARE * geometry.end_length_m
    return replace(
        geometry,
        active_length_m=geometry.active_length_m + 2.0 * given,
        end_length_m=geometry.end_length_m - given,
    )
