"""Scale the finite element rod law so that the rod returns a design's greatest bend and blocked force.

The rod is the uniform one that stands for the muscle with its ends (:mod:`~mbpam_ros.actuator.yielding_ends`). Per
pattern (PDC, PSC) two factors, on M0 and on B, such that it has, planar and in the posture of the paper's tests (base
down, tip up, weight on), at 100 kPa the tip angle theta_max when it is free
(:mod:`~mbpam_ros.actuator.planar_rod`) and pushes with F_max when a plate blocks its tip, with friction and large
deflection (:mod:`~mbpam_ros.actuator.blocked_rod`). The shapes over pressure and the stretch of the axis stay those of
the finite element unit cell; EA goes with B, and an axial force stretches and bends the rod as it does the full one
(:mod:`~mbpam_ros.actuator.elastic_rod`), which therefore returns the angle to 0.001 %.

For each trial factor on M0 the angle alone gives B; the secant method then finds the factor that gives the force. The
pressure is raised in steps of 5 kPa, because friction remembers; halving them changes the force by less than 0.2 %.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import newton

from mbpam_ros.actuator.bending_law import PATTERNS, stored_shear_modulus_pa
from mbpam_ros.actuator.blocked_rod import RodLoad, blocked_path
from mbpam_ros.actuator.built_muscle import ENDS_FILE, LAW_FILE, load_built
from mbpam_ros.actuator.design import INITIAL_DESIGN, MuscleDesign, MuscleGeometry, uniform_geometry
from mbpam_ros.actuator.drawing import PAPER, load_drawing, muscle_folder
from mbpam_ros.actuator.elastic_rod import solid_end
from mbpam_ros.actuator.end_law import finite_element_end_law
from mbpam_ros.actuator.measured_muscle import MeasuredMuscle
from mbpam_ros.actuator.metamodel import load_metamodel
from mbpam_ros.actuator.planar_rod import AxisStretch, RodSolutionError, stiffness_for_tip_angle
from mbpam_ros.actuator.rod_law import NOMINAL_PRESSURE_GAUGE_PA, PatternFactors, RodLaw, finite_element_rod_law
from mbpam_ros.actuator.tip_force import TipForce
from mbpam_ros.actuator.yielding_ends import finite_element_uniform_law, uniform_law

# Paper, section 3.1: measured on the initial design.
_MEASURED_PDC_DEG, _MEASURED_PDC_N = 151.0, 0.643
_MEASURED_PSC_DEG, _MEASURED_PSC_N = 120.0, 0.466

TARGETS = ("fe", "test")

_SHAPE_SIGMA, _LEAST_SHAPE_SIGMA_RAD = 0.011, math.radians(0.2)
"""What a hanging muscle's constant curvature departs by from the rod that the rig's curves are fitted with: 0.2 deg at
small bends, 1.1 % at 100 kPa (PDC)."""

_PRESSURES_PA = np.arange(10e3, NOMINAL_PRESSURE_GAUGE_PA + 1.0, 5e3)
_FACTOR_TOLERANCE = 1e-8
_MOST_TRIALS = 15


@dataclass(frozen=True)
class PatternTarget:
    """What the rod must return at 100 kPa: tip angle upright under gravity, and blocked tip force."""

    theta_max_rad: float
    f_max_n: float


def calibration_targets(design: MuscleDesign, metamodel: str = "prs", target: str = "fe") -> dict[str, PatternTarget]:
    """Return the targets of ``pdc`` and ``psc`` for a design.

    PDC comes from the metamodel (``target = "fe"``); for ``"test"`` times the ratio of measured value to the
    metamodel's at the initial design, which thereby returns the measured 151 deg and 0.643 N. PSC is PDC times the
    paper's measured ratios, 120/151 and 0.466/0.643: it has no samples of its own.

    Raises:
        ValueError: unknown metamodel or target; the message lists the known ones.
    """
    if target not in TARGETS:
        raise ValueError(f"unknown target {target!r}; known: {', '.join(TARGETS)}")
    model = load_metamodel(metamodel)
    performance = model.predict(design)
    pdc = PatternTarget(performance.theta_max_rad, performance.f_max_n)
    if target == "test":
        initial = model.predict(INITIAL_DESIGN)
        pdc = PatternTarget(
            pdc.theta_max_rad * math.radians(_MEASURED_PDC_DEG) / initial.theta_max_rad,
            pdc.f_max_n * _MEASURED_PDC_N / initial.f_max_n,
        )
    psc = PatternTarget(
        pdc.theta_max_rad * _MEASURED_PSC_DEG / _MEASURED_PDC_DEG, pdc.f_max_n * _MEASURED_PSC_N / _MEASURED_PDC_N
    )
    return {"pdc": pdc, "psc": psc}


@dataclass(frozen=True)
class Calibration:
    """What a design's muscle runs on: the law of the uniform rod that stands for it, and the force its blocked tip has.

    The rod's geometry is :func:`~mbpam_ros.actuator.design.uniform_geometry` of the muscle's. ``hysteresis_pa`` is by
    what its pressures are felt late (:mod:`~mbpam_ros.actuator.hysteresis`). Where bends were measured or computed for
    this muscle, ``bend_sigma`` is the relative standard deviation of a free one, and ``least_bend_sigma_rad`` what is
    left of it at small bends.
    """

    law: RodLaw
    tip_force: TipForce
    hysteresis_pa: float = 0.0
    bend_sigma: float | None = None
    least_bend_sigma_rad: float = 0.0


@functools.lru_cache(maxsize=16)
def calibrate(
    design: MuscleDesign, geometry: MuscleGeometry, metamodel: str = "prs", target: str = "fe"
) -> Calibration:
    """Return the calibration of a design. Cached: equal arguments give the same object.

    Args:
        design: of the muscle.
        geometry: of the muscle, not of the rod.
        metamodel: a key of :data:`~mbpam_ros.actuator.metamodel.METAMODELS`.
        target: ``fe`` for the paper's finite element values, ``test`` for its measured ones.

    Raises:
        ValueError: unknown metamodel or target.
        RodSolutionError: no factors give the rod its angle and its force.
    """
    targets = calibration_targets(design, metamodel, target)
    pdc = _factors("pdc", targets["pdc"], geometry)
    psc = _factors("psc", targets["psc"], geometry, pdc.stiffness)
    law = finite_element_uniform_law(geometry).scaled(psc=psc, pdc=pdc)
    return Calibration(law, blocked_tip_force(law, geometry))


def calibrate_built(name: str, geometry: MuscleGeometry) -> Calibration:
    """Return the calibration of a muscle of ``mbpam muscle build``: its own finite element law, as it is.

    Its ends are its own where they were computed, else the paper's muscle's, made similar to its size and silicone
    (:meth:`~mbpam_ros.actuator.end_law.EndLaw.scaled`).

    Args:
        name: of its drawing.
        geometry: of the muscle, not of the rod.

    Raises:
        ConfigError: it was not built, or its files hold something else.
        RodSolutionError: the blocked rod has no equilibrium.
    """
    built = load_built(name)
    path = muscle_folder(name) / LAW_FILE
    modulus_pa = stored_shear_modulus_pa(path)
    own_ends = muscle_folder(name) / ENDS_FILE
    if own_ends.is_file():
        joints = finite_element_end_law(own_ends)
    else:
        paper = load_drawing(PAPER).geometry
        joints = finite_element_end_law().scaled(
            geometry.outer_radius_m / paper.outer_radius_m, modulus_pa / stored_shear_modulus_pa()
        )
    law = uniform_law(finite_element_rod_law(path), geometry, solid_end(modulus_pa, geometry), joints)
    return Calibration(law, blocked_tip_force(law, geometry), bend_sigma=built.bend_sigma)


def calibrate_measured(drawn: Calibration, geometry: MuscleGeometry, measured: MeasuredMuscle) -> Calibration:
    """Return the calibration of a muscle that the rig measured.

    Args:
        drawn: the calibration that the measured factors multiply.
        geometry: of the muscle, not of the rod.
        measured: what the rig found.

    Raises:
        RodSolutionError: the blocked rod has no equilibrium.
    """
    law = drawn.law.scaled(psc=measured.psc, pdc=measured.pdc).stretched(measured.stretch)
    sigma = math.hypot(measured.bend_sigma, _SHAPE_SIGMA)
    return Calibration(law, blocked_tip_force(law, geometry), measured.hysteresis_pa, sigma, _LEAST_SHAPE_SIGMA_RAD)


def blocked_tip_force(law: RodLaw, geometry: MuscleGeometry) -> TipForce:
    """Return the force of a muscle's blocked tip.

    Args:
        law: of the uniform rod.
        geometry: of the muscle, not of the rod.

    Raises:
        RodSolutionError: the blocked rod has no equilibrium.
    """
    forces = {}
    for pattern in PATTERNS:
        loads = pattern_loads(law, pattern, _PRESSURES_PA)
        forces[f"{pattern}_moment_n_m"] = np.array([load.moment_n_m for load in loads])
        forces[f"{pattern}_force_n"] = np.array(
            [contact.push_n for contact in blocked_path(loads, uniform_geometry(geometry))]
        )
    return TipForce(**forces)


def calibrated_rod_law(
    design: MuscleDesign, geometry: MuscleGeometry, metamodel: str = "prs", target: str = "fe"
) -> RodLaw:
    """Return the rod law of :func:`calibrate`."""
    return calibrate(design, geometry, metamodel, target).law


def pattern_loads(law: RodLaw, pattern: str, pressure_gauge_pa: ArrayLike) -> list[RodLoad]:
    """Return the rod of ``psc`` or ``pdc`` at each pressure, its axis stretching where the law says how.

    Raises:
        ValueError: another pattern.
    """
    moment, stiffness = law.of_pattern(pattern, pressure_gauge_pa)
    pressure = np.asarray(pressure_gauge_pa, dtype=float)
    strains = {"pdc": law.pdc_strains, "psc": law.psc_strains}[pattern]
    if strains is None:
        return [RodLoad(*row) for row in np.stack([moment, stiffness], axis=-1).tolist()]
    free, slope, axial = (np.interp(pressure, law.pressure_gauge_pa, table) for table in strains[:3])
    rows = np.stack([moment, stiffness, 1.0 + free, slope, 1.0 / axial], axis=-1).tolist()
    return [RodLoad(row[0], row[1], AxisStretch(*row[2:])) for row in rows]


def _stiffened(load: RodLoad, stiffness_n_m2: float) -> AxisStretch:
    """The stretch of a rod whose B is ``stiffness_n_m2`` instead of ``load``'s: EA goes with it (``RodLaw.scaled``)."""
    softer = load.stiffness_n_m2 / stiffness_n_m2
    return load.stretch._replace(compliance_per_n=softer * load.stretch.compliance_per_n)


def _factors(
    pattern: str, target: PatternTarget, geometry: MuscleGeometry, pdc_stiffness: float | None = None
) -> PatternFactors:
    """Return the factors of ``pattern`` with which the rod returns ``target``; PSC's need PDC's on the stiffness."""
    law, rod = finite_element_uniform_law(geometry), uniform_geometry(geometry)
    unscaled = pattern_loads(law, pattern, _PRESSURES_PA)
    nominal = unscaled[-1]

    def trial(moment_factor: float) -> PatternFactors:
        moment = moment_factor * nominal.moment_n_m
        stiffness = nominal.stiffness_n_m2
        for _ in range(2):  # EA goes with B, and moves the angle by a hundred-thousandth
            stretch = _stiffened(nominal, stiffness)
            stiffness = stiffness_for_tip_angle(target.theta_max_rad, moment, rod, stretch=stretch)
        return PatternFactors(moment_factor, stiffness / nominal.stiffness_n_m2)

    def excess(log_factor: float) -> float:
        factors = trial(math.exp(log_factor))
        common = factors.stiffness if pdc_stiffness is None else pdc_stiffness
        stiffness = law.scaled_stiffness(pattern, _PRESSURES_PA, factors.stiffness, common).tolist()
        loads = [
            RodLoad(factors.moment * load.moment_n_m, value, _stiffened(load, value))
            for load, value in zip(unscaled, stiffness, strict=True)
        ]
        return math.log(blocked_path(loads, rod)[-1].push_n / target.f_max_n)

    try:
        start = excess(0.0)
        found = newton(excess, 0.0, x1=-start, tol=_FACTOR_TOLERANCE, maxiter=_MOST_TRIALS)
        return trial(math.exp(found))
    except (RuntimeError, ValueError, OverflowError) as error:
        raise RodSolutionError(
            f"{pattern}: no factors on M0 and B give the upright rod {math.degrees(target.theta_max_rad):.1f} deg and "
            f"the blocked one {target.f_max_n:.4f} N: {error}"
        ) from error
