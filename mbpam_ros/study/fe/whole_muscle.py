"""The whole muscle as finite elements: waves and ends, clamped at the base, its tip free, loaded or at a plate.

With x the nodes, an equilibrium obeys

    d/dx [ W(x) - sum_c p_c V_c(x) - sum_a m_a g . x_a - F . c(x) ] = moment's and plate's forces,

W the elastic energy, p_c and V_c the pressures and volumes of the closed chambers
(:mod:`~mbpam_ros.study.fe.chamber_volume`), m_a the nodes' masses, g gravity, F a dead force at the tip's centre c. The
moment follows the tip (:mod:`~mbpam_ros.study.fe.tip_face`). The frame is that of
:mod:`~mbpam_ros.study.fe.muscle_loads`.

``full`` is all of the muscle. The halves y >= 0 of ``pdc`` and ``psc`` stand for it where loads are symmetric in y = 0:
their nodes of that plane stay in it. For ``psc`` the muscle is turned by -45 deg, so that chamber 1 lies at +x; loads
are given in the turned frame then. In both the pressure of chamber 1 (and 4 in ``pdc``) bends toward -x, where the
plate of the blocked tip stands. All values a user sees are those of the whole muscle. Lengths in mm, forces in N,
pressures in MPa.

Not modelled: contact of the muscle with itself, viscosity.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csr_matrix
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from mbpam_ros.study.fe.chamber_volume import ChamberVolume
from mbpam_ros.study.fe.free_matrix import FreeMatrix
from mbpam_ros.study.fe.material import Silicone
from mbpam_ros.study.fe.mesh import CellGeometry, Resolution
from mbpam_ros.study.fe.muscle_loads import UPRIGHT, MuscleLoadError, MuscleLoads, Vector, pattern_pressures_mpa
from mbpam_ros.study.fe.muscle_mesh import EndPieces, muscle_mesh
from mbpam_ros.study.fe.plate_contact import ContactMemory, Plate, PlateContact
from mbpam_ros.study.fe.posture import SILICONE_DENSITY_KG_M3
from mbpam_ros.study.fe.section_frames import SectionFrames
from mbpam_ros.study.fe.solid_body import SolidBody
from mbpam_ros.study.fe.solve import (
    Chart,
    LinearSolver,
    LoadStepError,
    StepControl,
    UpdatedMatrix,
    follow_load,
    linear_solver,
)
from mbpam_ros.study.fe.tip_face import TipFace, TipPose

_REVISIONS_AT_ONCE = 3  # then one node after another
_MUSCLE_STEPS = StepControl(
    residual_n=1e-5, most_iterations=10, largest_step=0.1, smallest_step=1e-3, most_revisions=20
)
_SAME_CHAMBERS = {"pdc": ((1, 4), (2, 3)), "psc": ((2, 4),), "full": ()}  # mirror images of each other in y = 0
_AZIMUTH_RAD = {"pdc": 0.0, "psc": 0.25 * math.pi, "full": 0.0}  # of the model's x axis in the muscle frame
_SAME_NODE_MM = 1e-6


@dataclass(frozen=True, eq=False)
class MuscleState:
    """An equilibrium of the muscle.

    Args:
        loads: that act on it.
        tip: where the tip's face is.
        tip_angle_rad: between z and the tip's direction, continuous beyond half a turn.
        gas_volume_mm3: of all chambers under pressure.
        plate_force_n: of the muscle on the plate, x, y, z; zero without a plate.
        positions_mm: of the model's nodes, shape (nodes, 3).
        contact: memory of the plate's contact; None: there is no plate.
    """

    loads: MuscleLoads
    tip: TipPose
    tip_angle_rad: float
    gas_volume_mm3: float
    plate_force_n: NDArray[np.float64]
    positions_mm: NDArray[np.float64]
    contact: ContactMemory | None


class WholeMuscle:
    """Finite element model of the whole muscle.

    Args:
        geometry, resolution: see :mod:`~mbpam_ros.study.fe.mesh`.
        section: ``full``, or the half ``pdc`` or ``psc``.
        silicone: the material's constants.
        ends: the end pieces.
        plate: that the tip end may touch; None: the tip is free.
        solver: name of the sparse solver; by default the fastest one installed.
        control: of the load steps.

    Raises:
        ValueError: unknown section or solver, or a mesh that cannot be.
    """

    def __init__(
        self,
        geometry: CellGeometry,
        section: str = "pdc",
        resolution: Resolution | None = None,
        silicone: Silicone | None = None,
        ends: EndPieces | None = None,
        plate: Plate | None = None,
        solver: str | None = None,
        control: StepControl | None = None,
    ) -> None:
        self.geometry, self.section = geometry, section
        self.ends = ends or EndPieces()
        self.mesh = muscle_mesh(geometry, resolution or Resolution(), section, self.ends)
        self.mirrored = section != "full"
        self._parts = 2.0 if self.mirrored else 1.0
        points = self.mesh.points_mm
        self._body = SolidBody(points, self.mesh.cells, silicone or Silicone())
        self._gas = {chamber: ChamberVolume(faces) for chamber, faces in self.mesh.faces.items()}
        densities = np.where(self.mesh.cell_in_end, self.ends.density_factor, 1.0) * SILICONE_DENSITY_KG_M3 * 1e-9
        self._masses_kg = self._body.nodal_volumes_mm3(densities)
        skin = self.mesh.tip_skin
        shares = np.where(self.mirrored & (points[skin, 1] == 0.0), 0.5, 1.0)
        self._contact = PlateContact(plate, skin, shares) if plate else None
        self._tip = TipFace(points, self.mesh.tip_face, self.mirrored)
        self._solve: LinearSolver = linear_solver(solver, symmetric=self._contact is None or self._contact.symmetric)
        self._control = control or _MUSCLE_STEPS

        free = np.ones(points.shape, dtype=bool)
        if self.mirrored:
            free[points[:, 1] == 0.0, 1] = False
        free[points[:, 2] == 0.0] = False
        self._free = np.flatnonzero(free.ravel())
        self._free_matrix: FreeMatrix | None = None
        self.frames = SectionFrames(points, self.mirrored)

    @property
    def unknown_count(self) -> int:
        """Number of unknowns."""
        return self._free.size

    @property
    def mass_kg(self) -> float:
        """Mass of the muscle, both ends included."""
        return self._parts * float(self._masses_kg.sum())

    def inflated_loads(self, pressure_gauge_mpa: float, gravity_m_s2: Vector = UPRIGHT) -> MuscleLoads:
        """Return a half muscle's pressure with gravity, the tip free."""
        return MuscleLoads(pattern_pressures_mpa(self.section, pressure_gauge_mpa), gravity_m_s2=gravity_m_s2)

    def rest(self) -> MuscleState:
        """Return the state without loads."""
        points = self.mesh.points_mm
        return self._state(points, MuscleLoads(), self._contact.beside(points) if self._contact else None)

    def standing(self, gravity_m_s2: Vector = UPRIGHT) -> MuscleState:
        """Return the equilibrium of the muscle under its weight alone; a plate is put beside it then.

        Raises:
            LoadStepError: the weight could not be reached.
        """
        rest = self.rest()
        alone = self.moved(replace(rest, contact=None), MuscleLoads(gravity_m_s2=gravity_m_s2))
        return replace(alone, contact=self._contact.beside(alone.positions_mm) if self._contact else None)

    def moved(
        self,
        start: MuscleState,
        loads: MuscleLoads,
        report: Callable[[MuscleState], None] | None = None,
        control: StepControl | None = None,
    ) -> MuscleState:
        """Return the equilibrium at the end of the straight way of the loads from those of ``start``.

        Args:
            report: told every equilibrium on the way.
            control: of this way's steps, instead of the model's.

        Raises:
            MuscleLoadError: the model is half a muscle, and the loads are not symmetric.
            LoadStepError: the end could not be reached.
        """
        begin = start.loads
        if not self.takes(loads):
            raise MuscleLoadError(
                f"half a muscle ({self.section}) takes loads that are symmetric in y = 0 only, found {loads}; "
                "take the section 'full'"
            )
        if loads == begin:
            return start
        memory, revisions = start.contact, 0

        def positions(unknowns: NDArray[np.float64]) -> NDArray[np.float64]:
            flat = self.mesh.points_mm.ravel().copy()
            flat[self._free] = unknowns
            return flat.reshape(-1, 3)

        chart = Chart(
            lambda q: self.frames.coordinates(positions(q)),
            lambda coordinates: self.frames.positions_mm(coordinates).ravel()[self._free],
        )

        def accept(unknowns: NDArray[np.float64], part: float) -> bool:
            nonlocal memory, revisions
            x = positions(unknowns)
            if memory is not None and self._contact is not None:
                revised = self._contact.revised(x, memory, one_by_one=revisions >= _REVISIONS_AT_ONCE)
                if revised is not memory:
                    memory, revisions = revised, revisions + 1
                    return False
                memory, revisions = self._contact.settled(x, memory), 0
            if report is not None:
                report(self._state(x, begin.toward(loads, part), memory))
            return True

        try:
            found = follow_load(
                lambda q, part: self.forces_n(positions(q), begin.toward(loads, part), memory).ravel()[self._free],
                lambda q, part: self._tangent_of_free(positions(q), begin.toward(loads, part), memory),
                start.positions_mm.ravel()[self._free],
                self._solve,
                control or self._control,
                accept,
                chart,
            )
        except LoadStepError as error:
            reached = begin.toward(loads, error.reached)
            raise LoadStepError(
                f"the muscle stopped at {reached}: {error}", 1e3 * max(reached.pressures_gauge_mpa)
            ) from error
        return self._state(positions(found), loads, memory)

    def potential_n_mm(self, x: NDArray[np.float64], loads: MuscleLoads) -> float:
        """Return the potential of the model [N mm], half of the muscle's in a half; without plate and moment."""
        gas = sum(loads.pressures_gauge_mpa[chamber - 1] * gas.value(x) for chamber, gas in self._gas.items())
        weight = float(self._masses_kg @ (x @ loads.gravity_m_s2))
        tip = float(self._tip.pose(x).position_mm @ loads.tip_force_n) / self._parts
        return self._body.energy(x) - gas - weight - tip

    def forces_n(
        self, x: NDArray[np.float64], loads: MuscleLoads, memory: ContactMemory | None = None
    ) -> NDArray[np.float64]:
        """Return the forces out of balance on all nodes of the model, shape (nodes, 3)."""
        force = self._body.forces(x) - self._masses_kg[:, None] * loads.gravity_m_s2
        for chamber, gas in self._gas.items():
            if pressure_mpa := loads.pressures_gauge_mpa[chamber - 1]:
                force -= pressure_mpa * gas.gradient(x)
        force[self._tip.nodes] -= self._tip.forces_n(x, np.array(loads.tip_force_n), loads.tip_torque_n_mm)
        if memory is not None and self._contact is not None:
            force[self._contact.nodes] -= self._contact.pushes_n(x, memory)
        return force

    def tangent(
        self, x: NDArray[np.float64], loads: MuscleLoads, memory: ContactMemory | None = None
    ) -> csr_matrix | UpdatedMatrix:
        """Return the derivative of :meth:`forces_n` over 3 node + component.

        A sparse matrix, symmetric unless there is friction; with a moment at the tip its update of rank four.
        """
        stiffness = self._body.tangent(x)
        for chamber, values in self._gas_hessians(x, loads).items():
            places = self._gas[chamber].hessian_places
            stiffness = stiffness + coo_matrix((values, places), (x.size, x.size)).tocsr()
        if memory is not None and self._contact is not None:
            stiffness = stiffness + self._contact.tangent(x, memory)
        return self._with_torque(stiffness, x, loads, np.arange(x.size))

    def base_reaction_n(self, state: MuscleState) -> NDArray[np.float64]:
        """Return the clamp's force on the muscle [N], x, y, z."""
        force = self.forces_n(state.positions_mm, state.loads, state.contact)[self.mesh.points_mm[:, 2] == 0.0]
        return self._whole(force.sum(axis=0))

    def takes(self, loads: MuscleLoads) -> bool:
        """Whether the loads have the model's symmetry; all of the muscle takes any."""
        pressures = loads.pressures_gauge_mpa
        same = all(pressures[one - 1] == pressures[other - 1] for one, other in _SAME_CHAMBERS[self.section])
        sideways = (loads.tip_force_n[1], loads.tip_torque_n_mm, loads.gravity_m_s2[1])
        return not self.mirrored or (same and not any(sideways))

    def symmetric_part(self, loads: MuscleLoads) -> MuscleLoads:
        """Return the part of loads that a half takes: of two chambers the lower pressure, nothing across its plane."""
        pressures = list(loads.pressures_gauge_mpa)
        for one, other in _SAME_CHAMBERS[self.section]:
            pressures[one - 1] = pressures[other - 1] = min(pressures[one - 1], pressures[other - 1])
        first, second, third, fourth = pressures
        force, gravity = loads.tip_force_n, loads.gravity_m_s2
        return MuscleLoads(
            (first, second, third, fourth), (force[0], 0.0, force[2]), gravity_m_s2=(gravity[0], 0.0, gravity[2])
        )

    def loads_in_frame(self, loads: MuscleLoads) -> MuscleLoads:
        """Return loads of the muscle frame in the model's."""
        return loads.turned(-_AZIMUTH_RAD[self.section])

    def unfolded(self, state: MuscleState, half: WholeMuscle) -> MuscleState:
        """Return the state of this model, of all of the muscle, that a half is the half of.

        Args:
            state: of the half, without a plate.
            half: of the same geometry and resolution.

        Raises:
            ValueError: the nodes are not those of the half and their mirror images.
        """
        turn = Rotation.from_rotvec([0.0, 0.0, _AZIMUTH_RAD[half.section]])
        rest = turn.inv().apply(self.mesh.points_mm)
        sign = np.where(rest[:, 1:2] < -_SAME_NODE_MM, (1.0, -1.0, 1.0), 1.0)
        distance, node = cKDTree(half.mesh.points_mm).query(rest * sign)
        if distance.max() > _SAME_NODE_MM or len(self.mesh.points_mm) < len(half.mesh.points_mm):
            raise ValueError("the two models have different meshes")
        loads = state.loads.turned(_AZIMUTH_RAD[half.section])
        return self._state(turn.apply(state.positions_mm[node] * sign), loads, None)

    def _tangent_of_free(
        self, x: NDArray[np.float64], loads: MuscleLoads, memory: ContactMemory | None
    ) -> csr_matrix | UpdatedMatrix:
        """The rows and columns of :meth:`tangent` that belong to the unknowns."""
        free, body = self._free, self._body.tangent(x)
        if self._free_matrix is None:
            places = {chamber: gas.hessian_places for chamber, gas in self._gas.items()}
            self._free_matrix = FreeMatrix(body, free, places)
        stiffness = self._free_matrix.of(body, self._gas_hessians(x, loads))
        if memory is not None and self._contact is not None:
            stiffness = stiffness + self._contact.tangent(x, memory)[free][:, free]
        return self._with_torque(stiffness, x, loads, free)

    def _gas_hessians(self, x: NDArray[np.float64], loads: MuscleLoads) -> dict[int, NDArray[np.float64]]:
        """What the gas adds to the tangent, at its ``hessian_places``, by chamber under pressure."""
        return {
            chamber: -pressure_mpa * gas.hessian_values(x)
            for chamber, gas in self._gas.items()
            if (pressure_mpa := loads.pressures_gauge_mpa[chamber - 1])
        }

    def _with_torque(
        self, stiffness: csr_matrix, x: NDArray[np.float64], loads: MuscleLoads, kept: NDArray[np.int64]
    ) -> csr_matrix | UpdatedMatrix:
        if not loads.tip_torque_n_mm:
            return stiffness
        components = (3 * self._tip.nodes[:, None] + np.arange(3)).ravel()
        left, right = np.zeros((2, x.size, 4))
        left[components], right[components] = self._tip.torque_tangent(x, loads.tip_torque_n_mm)
        return UpdatedMatrix(stiffness, left[kept], right[kept])

    def _whole(self, force_n: NDArray[np.float64]) -> NDArray[np.float64]:
        """The whole muscle's force from the model's; y cancels by symmetry."""
        return 2.0 * force_n * (1.0, 0.0, 1.0) if self.mirrored else force_n

    def _state(self, x: NDArray[np.float64], loads: MuscleLoads, memory: ContactMemory | None) -> MuscleState:
        push, tip = np.zeros(3), self._tip.pose(x)
        if memory is not None and self._contact is not None:
            push = -self._whole(self._contact.pushes_n(x, memory).sum(axis=0))
        return MuscleState(
            loads=loads,
            tip=tip,
            tip_angle_rad=self.frames.angle_rad(x, tip.direction),
            gas_volume_mm3=self._parts * self._volume_under_pressure_mm3(x, loads),
            plate_force_n=push,
            positions_mm=x,
            contact=memory,
        )

    def _volume_under_pressure_mm3(self, x: NDArray[np.float64], loads: MuscleLoads) -> float:
        return sum(gas.value(x) for chamber, gas in self._gas.items() if loads.pressures_gauge_mpa[chamber - 1])
