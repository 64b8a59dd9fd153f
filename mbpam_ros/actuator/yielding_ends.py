r"""The muscle as one uniform rod between rigid ends: what its yielding ends do goes into that rod's law and length.

A muscle has ends of solid silicone that bend, stretch and twist, and where they meet the waves the axis turns, and
yields, by itself (:mod:`~mbpam_ros.actuator.end_law`). What runs in real time knows one section between two rigid ends.
So the active part is given a share of the ends, and its law is such that the whole is as compliant as the muscle. With
L and d the lengths of the waves and of an end, L' and d' = d + (L - L') / 2 those of the rod, X the section of the
waves and X_e that of an end, c_j, phi_j and l_j the joint's compliance, turn and length, and C = d / B_e + c_j:

    L' / B' = L / B + 2 C,   L' / EA' = L / EA + 2 d / EA_e,   L' / GJ' = L / GJ + 2 d / GJ_e,
    M0' = B' b' / L',   b' = b + 2 phi_j,   b = M0 L / B,

so that a uniform moment turns, and a pull or a torque about the axis moves, the tip as it does the muscle's. Q' and S'
likewise keep the slopes of the moment over the bend, in its plane and across it, at the free bend.

An arc is symmetric, and so is the muscle: with the angle b' right, its tip is in place when the distance between its
ends is. From the middle of the waves to the end's face, along the line between the ends, that is

    (1 + epsilon) L sin(b / 2) / b + h sin(b / 2) + (d + l_j) cos(b' / 2) = (1 + epsilon') L' sin(b' / 2) / b'
        + d' cos(b' / 2),

h being the joint's shift toward the inside of the bend. Asked for when held straight, where b = b' = h = l_j = 0, and
at the free bend, it gives the two numbers of epsilon' = epsilon_0' + c' kappa'. Without weight, PSC's and PDC's free
tips are therefore those of the muscle exactly.

What is not uniform is not told: L' is chosen so that the compliance has the muscle's second moment about its middle,
with which a force across the tip moves it as far,

    L'^2 / 12 (L / B + 2 C) = L^3 / (12 B) + 2 (d / B_e) ((L + d)^2 / 4 + d^2 / 12) + 2 c_j L^2 / 4,

which is 109 mm without pressure and 114 at 100 kPa (PDC). The ends do not want to bend, though, and the longer L' the
more of the bend is taken from the waves: 109 mm it is, 0.3 of each end. Beside the rod with ends of silicone, the
curve of the law and shear, in 48 drawn states of pressure and posture without loads, free tips are off by 1.0 mm rms
(2.4 at worst) and the axis by 1.4 mm (3.4) anywhere along it; with rigid ends by 3.7 (5.8) and 3.6 mm (5.7).
"""

from __future__ import annotations

import functools
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.actuator.bending_law import stored_shear_modulus_pa
from mbpam_ros.actuator.design import MuscleGeometry, uniform_geometry
from mbpam_ros.actuator.elastic_rod import RodSection, solid_end
from mbpam_ros.actuator.end_law import EndLaw, PatternEnds, finite_element_end_law
from mbpam_ros.actuator.gas_volume import LAW_FILE
from mbpam_ros.actuator.rod_law import BendCurve, RodLaw, StrainLaw, finite_element_rod_law

Array = NDArray[np.float64]


def uniform_law(law: RodLaw, geometry: MuscleGeometry, end: RodSection, joints: EndLaw) -> RodLaw:
    """Return the law of the uniform rod that stands for a muscle.

    Args:
        law: of the waves.
        geometry: of the muscle.
        end: section of its ends.
        joints: between them and the waves.
    """
    patterns = {pattern: _Pattern(law, pattern, geometry, end, joints) for pattern in ("psc", "pdc")}
    psc, pdc = patterns["psc"], patterns["pdc"]
    side = law.psc_side_stiffness_n_m2
    return RodLaw(
        law.pressure_gauge_pa,
        psc_moment_n_m=psc.moment_n_m,
        pdc_moment_n_m=pdc.moment_n_m,
        psc_stiffness_n_m2=psc.stiffness_n_m2,
        pdc_stiffness_n_m2=pdc.stiffness_n_m2,
        psc_strains=psc.strains(law.psc_strains),
        pdc_strains=pdc.strains(law.pdc_strains),
        psc_curve=psc.curve(law.psc_curve),
        pdc_curve=pdc.curve(law.pdc_curve),
        psc_side_stiffness_n_m2=None if side is None else psc.softened(side),
    )


@functools.lru_cache(maxsize=4)
def finite_element_uniform_law(geometry: MuscleGeometry, name: str | Path = LAW_FILE) -> RodLaw:
    """Return the law of the uniform rod that stands for a muscle of the finite elements' waves, ends and joints.

    Args:
        geometry: of the muscle.
        name: file of the waves' law.

    Raises:
        ConfigError: a stored law is missing or unreadable.
    """
    end = solid_end(stored_shear_modulus_pa(name), geometry)
    return uniform_law(finite_element_rod_law(name), geometry, end, finite_element_end_law())


class _Pattern:
    """One pattern's tables over the law's pressures, of the waves and of the rod that stands for the muscle."""

    def __init__(self, law: RodLaw, pattern: str, geometry: MuscleGeometry, end: RodSection, joints: EndLaw) -> None:
        self._waves, self._rod, self._end = geometry, uniform_geometry(geometry), end
        self._joint: PatternEnds = joints.of_pattern(pattern, law.pressure_gauge_pa)
        moment, self._waves_stiffness = law.of_pattern(pattern, law.pressure_gauge_pa)
        self._bend = moment * geometry.active_length_m / self._waves_stiffness
        self._bent = self._bend + 2.0 * self._joint.turn_rad
        self.stiffness_n_m2 = self.softened(self._waves_stiffness)
        self.moment_n_m = self.stiffness_n_m2 * self._bent / self._rod.active_length_m

    def softened(self, stiffness_n_m2: Array) -> Array:
        """Stiffness of the rod against bending where the waves' is this."""
        compliance = self._waves.end_length_m / self._end.stiffness_n_m2 + self._joint.compliance_per_n_m
        return self._in_series(1.0 / stiffness_n_m2, compliance)

    def _in_series(self, of_waves: Array, of_end: Array | float) -> Array:
        """Stiffness per length of the rod from the waves' compliance per length and that of an end."""
        return self._rod.active_length_m / (self._waves.active_length_m * of_waves + 2.0 * of_end)

    def strains(self, of: StrainLaw | None) -> StrainLaw | None:
        """How the rod stretches and twists."""
        if of is None:
            return None
        waves, rod, joint, end_m = self._waves, self._rod, self._joint, self._waves.end_length_m
        straight = of.free_stretch * waves.active_length_m / rod.active_length_m
        stretched = 1.0 + of.free_stretch + of.stretch_per_curvature_m * self._bend / waves.active_length_m
        half_sine = np.sin(0.5 * self._bend)
        reach = 0.5 * stretched * waves.active_length_m * _sinc(0.5 * self._bend) + joint.shift_m * half_sine
        reach += (end_m + joint.length_m - rod.end_length_m) * np.cos(0.5 * self._bent)
        bent = 2.0 * reach / (rod.active_length_m * _sinc(0.5 * self._bent)) - 1.0
        curvature = self._bent / rod.active_length_m
        slope = np.divide(bent - straight, curvature, out=np.zeros_like(bent), where=curvature > 0.0)
        return StrainLaw(
            straight,
            slope,
            self._in_series(1.0 / of.axial_stiffness_n, end_m * self._end.axial_compliance_per_n),
            self._in_series(1.0 / of.torsion_stiffness_n_m2, end_m * self._end.torsion_compliance_per_n_m2),
        )

    def curve(self, of: BendCurve | None) -> BendCurve | None:
        """How the rod's moment departs from its line."""
        if of is None:
            return None
        along = self.softened(self._waves_stiffness + of.stiffening_n_m3 * self._bend / self._waves.active_length_m)
        across = self.softened(self._waves_stiffness + of.side_n_m2)
        curvature = self._bent / self._rod.active_length_m
        stiffening = np.divide(along - self.stiffness_n_m2, curvature, out=np.zeros_like(along), where=curvature > 0.0)
        return BendCurve(stiffening, across - self.stiffness_n_m2)


def _sinc(angle_rad: Array) -> Array:
    sinc: Array = np.sinc(angle_rad / np.pi)
    return sinc
