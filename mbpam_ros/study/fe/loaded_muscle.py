"""States of the whole finite element muscle: where its tip lies under pressures, loads on the tip and gravity.

A state is reached as a muscle in the hand would reach it: its weight on first, then the pressure, then the load on its
tip. So where several equilibria exist it is the one on this way. (What of weight and pressure is not symmetric in the
plane of the bend is put on after the rest, before the load on the tip.)
"""

from __future__ import annotations

import math
import time
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from mbpam_ros.actuator.equilibrium import GRAVITY_M_S2
from mbpam_ros.study.fe.material import Silicone
from mbpam_ros.study.fe.mesh import CellGeometry, Resolution, arm_is_odd
from mbpam_ros.study.fe.muscle_loads import NOTHING, MuscleLoads
from mbpam_ros.study.fe.muscle_mesh import EndPieces
from mbpam_ros.study.fe.posture import END_LENGTH_MM, SILICONE_DENSITY_KG_M3, weight_n_mm
from mbpam_ros.study.fe.solve import StepControl
from mbpam_ros.study.fe.tip_face import TipPose
from mbpam_ros.study.fe.versions import library_versions
from mbpam_ros.study.fe.whole_muscle import MuscleState, WholeMuscle
from mbpam_ros.study.muscle_states import MuscleState as Description

MESHES = {
    "converged": Resolution(wave=6, wall=2, arm=2, spoke=2, sector=2, quadratic=True),
    "medium": Resolution(wave=6, wall=1, arm=2, spoke=2, sector=2, quadratic=True),
    "light": Resolution(wave=6, wall=1, arm=1, spoke=2, sector=2, quadratic=True),
    "coarse": Resolution(wave=4, wall=1, arm=2, spoke=2, sector=2),
}
"""Meshes of all of the muscle by name. ``converged`` bends within 1.5 % of the law at 80 and 100 kPa (2.5 to
4 % less at 50); ``medium``, with one element through the wall, bends 2 % further. ``light`` costs a fifth and bends
0.7 % further at 100 kPa, 2 % less at 80, but is not for one chamber between 65 and 85 kPa: with one reduced element
across half an arm the cross buckles there aside, as it does not with two. ``coarse`` is to try things."""

WALL_MM = 2.3
"""Wall c that returns the paper's bends with 20-node elements, as 2.1 mm does with the unit cell's default mesh."""

END_WEIGHT_FACTOR = 1.0
"""Weight per length of the ends over the waved part's mean: that of the rod, which has one mass per length."""

S_PER_STATE = {"converged": 400.0, "medium": 250.0, "light": 90.0, "coarse": 20.0}
"""CPU of one state from rest, a guess."""

NOT_MODELLED = ("self-contact", "viscosity")

_NEAREST_HALF = {"pdc": "pdc", "psc": "psc", "half": "psc"}  # the symmetry of most of a pattern's pressures

_TO_PRESSURE = StepControl(residual_n=1e-6, first_step=0.25, largest_step=0.5, smallest_step=0.01)
_OUT_OF_PLANE = StepControl(residual_n=1e-6, first_step=0.3, largest_step=1.0, smallest_step=0.01)
_TO_LOAD = StepControl(residual_n=1e-6, first_step=1.0, largest_step=1.0, smallest_step=0.02)


@dataclass(frozen=True)
class MuscleModel:
    """The muscle that is run; a plain value, so that any executor can send it anywhere.

    Args:
        geometry: of the waved part.
        mesh: a name in :data:`MESHES`.
        end_length_mm: of the solid silicone piece at each end.
        end_weight_factor: its weight per length over the waved part's mean.
        silicone: of all of it, ends included.

    Raises:
        ValueError: unknown mesh, or an end that cannot be.
    """

    geometry: CellGeometry = field(default_factory=lambda: CellGeometry(c_mm=WALL_MM))
    mesh: str = "converged"
    end_length_mm: float = END_LENGTH_MM
    end_weight_factor: float = END_WEIGHT_FACTOR
    silicone: Silicone = field(default_factory=Silicone)

    def __post_init__(self) -> None:
        if self.mesh not in MESHES:
            raise ValueError(f"unknown mesh {self.mesh!r}; known: {', '.join(MESHES)}")
        self.ends  # noqa: B018 - refuses what cannot be

    @property
    def ends(self) -> EndPieces:
        """The end pieces; a density that gives them their weight."""
        solid_kg_m = 1e-6 * SILICONE_DENSITY_KG_M3 * math.pi * self.geometry.outer_radius_mm**2
        return EndPieces(self.end_length_mm, self.end_length_mm, self._masses_kg_m["ends"] / solid_kg_m)

    @property
    def _masses_kg_m(self) -> dict[str, float]:
        waves = 1e3 * weight_n_mm(self.geometry) / GRAVITY_M_S2
        return {"waves": waves, "ends": self.end_weight_factor * waves}

    def muscle(self, section: str = "full") -> WholeMuscle:
        """Return the finite element model of all of the muscle, or of the half ``pdc`` or ``psc``."""
        return WholeMuscle(self.geometry, section, MESHES[self.mesh], self.silicone, self.ends)

    def settings(self) -> dict[str, Any]:
        """Return what the numbers depend on, and the versions they were made with."""
        return {
            "geometry": self.geometry.settings(),
            "mesh": {"name": self.mesh, **MESHES[self.mesh].settings()},
            "silicone": asdict(self.silicone),
            "density_kg_m3": SILICONE_DENSITY_KG_M3,
            "ends": {"length_mm": self.end_length_mm, "of": "solid silicone", "weight_factor": self.end_weight_factor},
            "mass_per_length_kg_m": self._masses_kg_m,
            "not_modelled": list(NOT_MODELLED),
            "versions": library_versions(),
        }


class LoadedMuscle:
    """Answers states one after the other, each from the last one on its way that has been found.

    States of one pattern and gravity in the order of rising pressure cost least.

    Args:
        model: the muscle.
    """

    def __init__(self, model: MuscleModel) -> None:
        self._model, self._muscle = model, model.muscle()
        self._halves: dict[str, WholeMuscle] = {}
        self._free: MuscleState | None = None  # the last one of all of the muscle without load on the tip
        self._ways: dict[str, list[MuscleState]] = {}  # of each section: rest, weight on, pressures rising
        points = self._muscle.mesh.points_mm
        frames = self._muscle.frames
        crests = model.end_length_mm + model.geometry.wave_length_mm * np.arange(round(model.geometry.wave_count) + 1)
        self._crests = [int(np.abs(frames.z_mm - z).argmin()) for z in crests]
        on_axis = np.flatnonzero(np.hypot(points[:, 0], points[:, 1]) < 1e-9)
        nearest = np.abs(points[on_axis, 2] - frames.z_mm[self._crests, None]).argmin(axis=1)
        self._axis_nodes = on_axis[nearest].tolist()

    @property
    def unknown_count(self) -> int:
        """Number of unknowns of the finite elements."""
        return self._muscle.unknown_count

    @property
    def mass_kg(self) -> float:
        """Mass of all of the muscle."""
        return self._muscle.mass_kg

    def row(self, wanted: Description) -> dict[str, Any]:
        """Return a state with its answer, as a row of a file of states; all values are plain.

        ``axis`` is the muscle's axis at the crests, from where the waves begin to where they end: ``z_mm`` at rest,
        position, direction and roll. ``cpu_s`` is what this state took beyond those before it.

        Raises:
            LoadStepError: it could not be reached.
        """
        began_s = time.process_time()
        state = self._found(loads_of(wanted), loads_of(wanted.unloaded), wanted.pattern)
        return {
            "pattern": wanted.pattern,
            "pressure_kpa": wanted.pressure_kpa,
            "tip_force_n": list(wanted.tip_force_n),
            "tip_torque_n_mm": wanted.tip_torque_n_mm,
            "gravity_m_s2": list(wanted.gravity_m_s2),
            **{f"tip_{name}": value for name, value in _pose(state.tip).items()},
            "tip_angle_deg": round(math.degrees(state.tip_angle_rad), 6),
            "gas_volume_mm3": round(state.gas_volume_mm3, 3),
            "axis": self._axis(state),
            "cpu_s": round(time.process_time() - began_s, 1),
        }

    def _found(self, loads: MuscleLoads, unloaded: MuscleLoads, pattern: str) -> MuscleState:
        """What is symmetric in a plane is solved with the half, at a quarter of the cost; the rest comes last."""
        half = self._half(_NEAREST_HALF[pattern])
        if half is None:
            return self._muscle.moved(self._on_the_way(self._muscle, unloaded), loads, control=_TO_LOAD)
        own, own_unloaded = half.loads_in_frame(loads), half.loads_in_frame(unloaded)
        start = self._on_the_way(half, half.symmetric_part(own_unloaded))
        if half.takes(own):
            return self._muscle.unfolded(half.moved(start, own, control=_TO_LOAD), half)
        if self._free is None or self._free.loads != unloaded:
            self._free = self._muscle.moved(self._muscle.unfolded(start, half), unloaded, control=_OUT_OF_PLANE)
        return self._muscle.moved(self._free, loads, control=_TO_LOAD)

    def _half(self, section: str) -> WholeMuscle | None:
        """The half, if it can be meshed."""
        if section == "psc" and arm_is_odd(MESHES[self._model.mesh]):
            return None
        if section not in self._halves:
            self._halves[section] = self._model.muscle(section)
        return self._halves[section]

    def _on_the_way(self, muscle: WholeMuscle, loads: MuscleLoads) -> MuscleState:
        """Go on from the model's last state on the way to these pressures and this gravity."""
        way = [state for state in self._ways.get(muscle.section, []) if _is_on_the_way(state.loads, loads)]
        way = way or [muscle.rest()]
        for wanted in (MuscleLoads(gravity_m_s2=loads.gravity_m_s2), loads):
            if not _is_on_the_way(wanted, way[-1].loads):
                way.append(muscle.moved(way[-1], wanted, control=_TO_PRESSURE))
        self._ways[muscle.section] = way
        return way[-1]

    def _axis(self, state: MuscleState) -> list[dict[str, Any]]:
        x, frames = state.positions_mm, self._muscle.frames
        rotations = frames.rotations(x)
        return [
            {"z_mm": round(float(frames.z_mm[plane]), 4), **_pose(TipPose(x[node], rotations[plane]))}
            for plane, node in zip(self._crests, self._axis_nodes, strict=True)
        ]


def loads_of(wanted: Description) -> MuscleLoads:
    """Return the loads of a state."""
    first, second, third, fourth = (1e-6 * wanted.pressure_gauge_pa).tolist()
    return MuscleLoads((first, second, third, fourth), wanted.tip_force_n, wanted.tip_torque_n_mm, wanted.gravity_m_s2)


def _is_on_the_way(loads: MuscleLoads, end: MuscleLoads) -> bool:
    """Whether the way by weight, then pressure to ``end`` passes ``loads``; the end does."""
    pressures, wanted = np.array(loads.pressures_gauge_mpa), np.array(end.pressures_gauge_mpa)
    if not pressures.any():
        return loads.gravity_m_s2 in (NOTHING, end.gravity_m_s2)
    part = pressures.max() / wanted.max() if wanted.any() else math.inf
    return loads.gravity_m_s2 == end.gravity_m_s2 and part <= 1.0 and np.allclose(pressures, part * wanted, rtol=1e-12)


def _pose(pose: TipPose) -> dict[str, Any]:
    return {
        "position_mm": pose.position_mm.round(6).tolist(),
        "direction": pose.direction.round(8).tolist(),
        "roll_deg": round(math.degrees(pose.roll_rad), 6),
    }
