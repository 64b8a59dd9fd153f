"""One design, run through the finite elements: bend against pressure, and what it does at 100 kPa.

Angles are those of the paper's posture (base down, tip up, weight on; :mod:`~mbpam_ros.study.fe.posture`). The blocked
force is that of the straight propped rod, F = M0 int(x) / int(x^2), with the moment M0 that holds the cell straight.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from mbpam_ros.actuator.design import MuscleGeometry
from mbpam_ros.actuator.equilibrium import GRAVITY_M_S2
from mbpam_ros.actuator.planar_rod import RodSolutionError, blocked_tip_force_per_moment
from mbpam_ros.study.fe.law import SHORT_WAY, BendingLaw, LawError
from mbpam_ros.study.fe.material import Silicone
from mbpam_ros.study.fe.mesh import CONVERGED, FAST, CellGeometry, Resolution
from mbpam_ros.study.fe.posture import (
    END_LENGTH_MM,
    END_WEIGHT_FACTOR,
    SILICONE_DENSITY_KG_M3,
    PostureError,
    upright_tip_angle_rad,
    weight_n_mm,
)
from mbpam_ros.study.fe.solve import LoadStepError, StepControl
from mbpam_ros.study.fe.unit_cell import CellState, UnitCell
from mbpam_ros.study.fe.versions import library_versions

NOMINAL_KPA = 100.0
SELF_CONTACT, CONTACT_OF_FOLDS = "self-contact", "contact of folds"
NOT_MODELLED = (SELF_CONTACT, "viscosity", "end caps", "sliding contact of the blocked tip")

DEFAULT_MESH, FAST_MESH = "quadratic", "trilinear"
FAST_WALL_MM = 2.1
"""The wall c that goes with the fast mesh: what the mesh lacks in flexibility a thinner wall makes up for."""

MESHES = {
    DEFAULT_MESH: CONVERGED,
    FAST_MESH: FAST,
    "tetrahedra": Resolution(tetrahedra="grouped"),
    "coarse": Resolution(wave=4, wall=1, arm=2, spoke=2, sector=2),
}
"""Meshes by name. ``quadratic`` (20-node elements, reduced integration) is the default; what is left of its error says
``mbpam fe mesh``. ``trilinear`` (8-node elements with mean dilatation) is fast and bends 5 to 25 % too little; with a
wall of :data:`FAST_WALL_MM` it returns the paper's bends as well. ``tetrahedra`` cuts each of its hexahedra into 24
linear ones with one mean dilatation, for the paper's hybrid tetrahedra. ``coarse`` is for trying things out."""

NO_EQUILIBRIUM = (LoadStepError, LawError, PostureError, RodSolutionError)
"""What a run raises when the finite elements or the rod find no equilibrium."""

S_PER_JOB = 20.0
"""CPU of a bend curve with the default mesh; 20-node elements take several times as long."""


@dataclass(frozen=True)
class Run:
    """One finite element job; a plain value, so that any executor can send it anywhere.

    Args:
        geometry, pattern, resolution, silicone: of the unit cell.
        end_length_mm: straight piece at each end.
        end_weight_factor: its weight per length over the waved part's mean.
        self_contact: of the cross's arms with the wall of chambers without pressure.
        density_kg_m3: of the silicone.

    Raises:
        ValueError: an end's length or weight is negative or not finite.
    """

    geometry: CellGeometry
    pattern: str
    resolution: Resolution = CONVERGED
    silicone: Silicone = field(default_factory=Silicone)
    end_length_mm: float = END_LENGTH_MM
    end_weight_factor: float = END_WEIGHT_FACTOR
    self_contact: bool = False
    density_kg_m3: float = SILICONE_DENSITY_KG_M3

    def __post_init__(self) -> None:
        for name in ("end_length_mm", "end_weight_factor"):
            value = getattr(self, name)
            if not 0.0 <= value < math.inf:
                raise ValueError(f"{name} must be zero or more and finite, found {value}")

    def cell(self, control: StepControl | None = None) -> UnitCell:
        """Return the unit cell of this job."""
        return UnitCell(
            self.geometry,
            self.pattern,
            self.resolution,
            self.silicone,
            control=control,
            self_contact=self.self_contact,
        )

    def muscle_geometry(self) -> MuscleGeometry:
        """Return the muscle as a rod, its weight that of the waved part."""
        geometry = self.geometry
        return MuscleGeometry(
            1e-3 * geometry.outer_radius_mm,
            1e-3 * self.end_length_mm,
            1e-3 * geometry.active_length_mm,
            1e3 * weight_n_mm(geometry, self.density_kg_m3) / GRAVITY_M_S2,
        )

    def upright_tip_angle_rad(self, law: BendingLaw, end_weight_factor: float | None = None) -> float:
        """Return the tip angle in the paper's posture with the law of one pressure.

        Args:
            end_weight_factor: another weight of the ends.

        Raises:
            LoadStepError, LawError, PostureError: no equilibrium was found.
        """
        factor = self.end_weight_factor if end_weight_factor is None else end_weight_factor
        return upright_tip_angle_rad(law, self.geometry, self.end_length_mm, factor, density_kg_m3=self.density_kg_m3)


def fast_reading(pattern: str) -> Run:
    """Return the run of the initial design on the fast mesh, with its wall."""
    return Run(CellGeometry(c_mm=FAST_WALL_MM), pattern, FAST)


def nominal_values(run: Run, end_weight_factors: Sequence[float] = ()) -> dict[str, Any]:
    """Return what one design does at 100 kPa.

    Bend [deg] without and with weight, held-straight moment, blocked force, clearance of the freely bent cell. The
    law's samples come with it, so that other postures and weights need no finite elements.

    Args:
        end_weight_factors: other weights of the ends, for each of which the bend is given under
            ``theta_deg_by_end_weight``, in this order.

    Raises:
        LoadStepError, LawError, PostureError: the finite elements or the rod found no equilibrium.
    """
    cell = run.cell()
    return values_at(run, cell, cell.free_bend(1e-3 * NOMINAL_KPA), end_weight_factors)


def values_at(run: Run, cell: UnitCell, free: CellState, end_weight_factors: Sequence[float] = ()) -> dict[str, Any]:
    """Return :func:`nominal_values` where the free bend is known.

    Args:
        run: the design.
        cell: its unit cell.
        free: the cell's free bend at 100 kPa.
        end_weight_factors: as there.

    Raises:
        LoadStepError, LawError, PostureError: as there.
    """
    law = BendingLaw(cell, [free])
    upright_rad = run.upright_tip_angle_rad(law)
    others_rad = [run.upright_tip_angle_rad(law, factor) for factor in end_weight_factors]
    straight = cell.held_bend(free.pressure_gauge_mpa, 0.0)
    moment_n_mm = -straight.moment_n_mm
    return {
        "free_bend_deg": math.degrees(free.angle_rad) * cell.angle_per_muscle,
        "theta_deg": math.degrees(upright_rad),
        "straight_moment_n_mm": moment_n_mm,
        "force_n": 1e-3 * moment_n_mm * blocked_tip_force_per_moment(run.muscle_geometry()),
        **asdict(cell.clearance(free)),
        **({"theta_deg_by_end_weight": np.degrees(others_rad).tolist()} if others_rad else {}),
        "bend_samples_deg": np.degrees(law.bend_rad).tolist(),
        "moment_samples_n_mm": law.moment_n_mm.tolist(),
        "axis_stretch_samples": law.axis_stretch.tolist(),
    }


def bend_curve(run: Run, pressures_kpa: Sequence[float]) -> dict[str, list[float]]:
    """Return ``p_kpa`` and ``theta_deg`` in the paper's posture, pressures rising.

    Raises:
        LoadStepError, LawError, PostureError: as in :func:`nominal_values`.
    """
    cell = run.cell(SHORT_WAY)
    states, angles = [cell.rest()], []
    for pressure_kpa in pressures_kpa:
        if pressure_kpa != 1e3 * states[-1].pressure_gauge_mpa:
            states.append(cell.free_bend(1e-3 * pressure_kpa, states[-1], states[:-1]))
        law = BendingLaw(cell, states[-1:])
        angles.append(math.degrees(run.upright_tip_angle_rad(law)))
    return {"p_kpa": [float(value) for value in pressures_kpa], "theta_deg": angles}


def settings(run: Run) -> dict[str, object]:
    """Return what the numbers depend on besides a and b, and the versions they were made with."""
    geometry = run.geometry.settings()
    wave = (
        "R - a/2 (1 - cos(2 pi z / lambda))" if run.geometry.wave_fillet_mm is None else "of arcs and straight flanks"
    )
    del geometry["a_mm"], geometry["b_mm"]
    return {
        "convention": f"outer radius {wave}; radial wall c; chambers x, y > b/2",
        "geometry": {**geometry, "end_length_mm": run.end_length_mm, "end_weight_factor": run.end_weight_factor},
        "resolution": run.resolution.settings(),
        "silicone": asdict(run.silicone),
        "not_modelled": [
            CONTACT_OF_FOLDS if run.self_contact and what == SELF_CONTACT else what for what in NOT_MODELLED
        ],
        "versions": library_versions(),
    }
