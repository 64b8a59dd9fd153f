"""Design of a muscle and the domain in which the paper's data speak about it."""

from __future__ import annotations

from dataclasses import dataclass

from mbpam_ros.configuration import require_positive


class DesignDomainError(ValueError):
    """The design lies outside the samples of the paper; no metamodel may be asked there."""


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

    A_RANGE_MM = (1.5, 3.5)
    B_RANGE_MM = (1.0, 3.0)

    def __post_init__(self) -> None:
        (a_low, a_high), (b_low, b_high) = self.A_RANGE_MM, self.B_RANGE_MM
        if not (a_low <= self.a_mm <= a_high and b_low <= self.b_mm <= b_high):
            nearest = (min(max(self.a_mm, a_low), a_high), min(max(self.b_mm, b_low), b_high))
            raise DesignDomainError(
                f"design a = {self.a_mm:g} mm, b = {self.b_mm:g} mm is outside the sampled domain "
                f"{a_low:g} <= a <= {a_high:g} mm, {b_low:g} <= b <= {b_high:g} mm; "
                f"the nearest design inside is a = {nearest[0]:g}, b = {nearest[1]:g} mm"
            )


@dataclass(frozen=True)
class MuscleGeometry:
    """What the paper holds fixed, and the mass along the muscle. SI units.

    Args:
        outer_radius_m: crest radius of the muscle.
        end_length_m: unwaved, rigid piece at each end.
        active_length_m: waved length between the ends that bends.
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
