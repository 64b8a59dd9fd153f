"""The whole muscle as finite elements: waves and ends, clamped at the base, its weight on, its tip free or at a plate.

With x the nodes of the half muscle y >= 0, an equilibrium obeys

    d/dx [ W(x) - sum_c p_c V_c(x) + g sum_a m_a z_a ] = plate's forces,

W the elastic energy, V_c the closed chambers' volumes (:mod:`~mbpam_ros.study.fe.chamber_volume`), m_a the nodes'
masses (a dead load: base down, tip up). The chambers under pressure lie at +x; the muscle bends toward -x, where the
plate of the blocked tip stands. Nodes of the base stay where they are, nodes of the symmetry plane stay in it. All
values a user sees are those of the whole muscle. Lengths in mm, forces in N, pressures in MPa.

Not modelled: contact of the muscle with itself, viscosity.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csr_matrix

from mbpam_ros.actuator.equilibrium import GRAVITY_M_S2
from mbpam_ros.study.fe.chamber_volume import ChamberVolume
from mbpam_ros.study.fe.material import Silicone
from mbpam_ros.study.fe.mesh import CellGeometry, Resolution
from mbpam_ros.study.fe.muscle_mesh import EndPieces, muscle_mesh
from mbpam_ros.study.fe.plate_contact import ContactMemory, Plate, PlateContact
from mbpam_ros.study.fe.posture import SILICONE_DENSITY_KG_M3
from mbpam_ros.study.fe.section_frames import SectionFrames
from mbpam_ros.study.fe.solid_body import SolidBody
from mbpam_ros.study.fe.solve import Chart, LinearSolver, LoadStepError, StepControl, follow_load, linear_solver

_HALVES = 2.0  # the model is half the muscle
_PRESSURISED = 1  # chamber 1 of the half muscle; pdc: the other half's mirror image of it; psc: its other half
_REVISIONS_AT_ONCE = 3  # then one node after another
_MUSCLE_STEPS = StepControl(
    residual_n=1e-5, most_iterations=10, largest_step=0.1, smallest_step=1e-3, most_revisions=20
)


@dataclass(frozen=True, eq=False)
class MuscleState:
    """An equilibrium of the muscle.

    Args:
        pressure_gauge_mpa: in the pressurised chambers.
        gravity_factor: of the weight; 1 with gravity, 0 without.
        tip_angle_rad: of the tip's plane against the base; positive toward -x, away from the chambers under pressure.
        gas_volume_mm3: of all pressurised chambers.
        plate_force_n: of the muscle on the plate, x, y, z; zero without a plate. y cancels by symmetry.
        positions_mm: of the half muscle's nodes, shape (nodes, 3).
        contact: memory of the plate's contact; None: there is no plate.
    """

    pressure_gauge_mpa: float
    gravity_factor: float
    tip_angle_rad: float
    gas_volume_mm3: float
    plate_force_n: NDArray[np.float64]
    positions_mm: NDArray[np.float64]
    contact: ContactMemory | None


class WholeMuscle:
    """Finite element model of the whole muscle.

    Args:
        geometry, resolution: see :mod:`~mbpam_ros.study.fe.mesh`.
        pattern: ``pdc`` (two adjacent chambers under pressure) or ``psc`` (one).
        silicone: the material's constants.
        ends: the end pieces.
        plate: that the tip end may touch; None: the tip is free.
        solver: name of the sparse solver; by default the fastest one installed.
        control: of the load steps.

    Raises:
        ValueError: unknown pattern or solver, or a mesh that cannot be.
    """

    def __init__(
        self,
        geometry: CellGeometry,
        pattern: str = "pdc",
        resolution: Resolution | None = None,
        silicone: Silicone | None = None,
        ends: EndPieces | None = None,
        plate: Plate | None = None,
        solver: str | None = None,
        control: StepControl | None = None,
    ) -> None:
        self.geometry, self.pattern = geometry, pattern
        self.ends = ends or EndPieces()
        self.mesh = muscle_mesh(geometry, resolution or Resolution(), pattern, self.ends)
        points = self.mesh.points_mm
        self._body = SolidBody(points, self.mesh.cells, silicone or Silicone())
        self._gas = ChamberVolume(self.mesh.faces[_PRESSURISED])
        densities = np.where(self.mesh.cell_in_end, self.ends.density_factor, 1.0) * SILICONE_DENSITY_KG_M3 * 1e-9
        self._weights_n = GRAVITY_M_S2 * self._body.nodal_volumes_mm3(densities)
        skin = self.mesh.tip_skin
        shares = np.where(points[skin, 1] == 0.0, 0.5, 1.0)
        self._contact = PlateContact(plate, skin, shares) if plate else None
        self._solve: LinearSolver = linear_solver(solver, symmetric=self._contact is None or self._contact.symmetric)
        self._control = control or _MUSCLE_STEPS

        free = np.ones(points.shape, dtype=bool)
        free[points[:, 1] == 0.0, 1] = False
        free[points[:, 2] == 0.0] = False
        self._free = np.flatnonzero(free.ravel())
        self.frames = SectionFrames(points)

    @property
    def unknown_count(self) -> int:
        """Number of unknowns."""
        return self._free.size

    @property
    def weight_n(self) -> float:
        """Weight of the muscle [N], both ends included."""
        return _HALVES * float(self._weights_n.sum())

    def rest(self) -> MuscleState:
        """Return the state without pressure and weight."""
        points = self.mesh.points_mm
        return self._state(points, 0.0, 0.0, self._contact.beside(points) if self._contact else None)

    def standing(self, gravity_factor: float = 1.0) -> MuscleState:
        """Return the equilibrium of the upright muscle under its weight alone; a plate is put beside it then.

        Raises:
            LoadStepError: the weight could not be reached.
        """
        rest = self.rest()
        alone = self.moved(replace(rest, contact=None), 0.0, gravity_factor)
        return replace(alone, contact=self._contact.beside(alone.positions_mm) if self._contact else None)

    def inflated(self, pressure_gauge_mpa: float, gravity_factor: float = 1.0) -> MuscleState:
        """Return the equilibrium of the muscle that stood upright under its weight and was inflated then.

        Raises:
            LoadStepError: the pressure could not be reached.
        """
        return self.moved(self.standing(gravity_factor), pressure_gauge_mpa, gravity_factor)

    def moved(
        self,
        start: MuscleState,
        pressure_gauge_mpa: float,
        gravity_factor: float,
        report: Callable[[MuscleState], None] | None = None,
    ) -> MuscleState:
        """Return the equilibrium at the end of the straight way of pressure and weight from ``start``.

        Args:
            report: told every equilibrium on the way.

        Raises:
            LoadStepError: the end could not be reached.
        """
        begin = np.array([start.pressure_gauge_mpa, start.gravity_factor])
        end = np.array([pressure_gauge_mpa, gravity_factor])
        if np.array_equal(begin, end):
            return start
        memory, revisions = start.contact, 0

        def loads(part: float) -> tuple[float, float]:
            pressure, gravity = begin + part * (end - begin)
            return pressure, gravity

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
                report(self._state(x, *loads(part), memory))
            return True

        try:
            found = follow_load(
                lambda q, part: self.forces_n(positions(q), *loads(part), memory).ravel()[self._free],
                lambda q, part: self.tangent(positions(q), loads(part)[0], memory)[self._free][:, self._free],
                start.positions_mm.ravel()[self._free],
                self._solve,
                self._control,
                accept,
                chart,
            )
        except LoadStepError as error:
            pressure, gravity = loads(error.reached)
            raise LoadStepError(
                f"the muscle stopped at {1e3 * pressure:.2f} kPa and {gravity:.0%} of its weight: {error}",
                1e3 * pressure,
            ) from error
        return self._state(positions(found), pressure_gauge_mpa, gravity_factor, memory)

    def potential_n_mm(self, x: NDArray[np.float64], pressure_gauge_mpa: float, gravity_factor: float) -> float:
        """Return the potential of the half muscle [N mm] without the plate."""
        weight = gravity_factor * float(self._weights_n @ x[:, 2])
        return self._body.energy(x) - pressure_gauge_mpa * self._gas.value(x) + weight

    def forces_n(
        self,
        x: NDArray[np.float64],
        pressure_gauge_mpa: float,
        gravity_factor: float,
        memory: ContactMemory | None = None,
    ) -> NDArray[np.float64]:
        """Return the forces out of balance on all nodes of the half muscle, shape (nodes, 3)."""
        force = self._body.forces(x) - pressure_gauge_mpa * self._gas.gradient(x)
        force[:, 2] += gravity_factor * self._weights_n
        if memory is not None and self._contact is not None:
            force[self._contact.nodes] -= self._contact.pushes_n(x, memory)
        return force

    def tangent(
        self, x: NDArray[np.float64], pressure_gauge_mpa: float, memory: ContactMemory | None = None
    ) -> csr_matrix:
        """Return the derivative of :meth:`forces_n` over 3 node + component; symmetric unless there is friction."""
        values, rows, columns = self._gas.hessian_entries(x)
        gas = coo_matrix((pressure_gauge_mpa * values, (rows, columns)), (x.size, x.size)).tocsr()
        stiffness = self._body.tangent(x) - gas
        if memory is not None and self._contact is not None:
            stiffness = stiffness + self._contact.tangent(x, memory)
        return stiffness

    def base_reaction_n(self, state: MuscleState) -> NDArray[np.float64]:
        """Return the clamp's force on the muscle [N], x, y, z; y cancels by symmetry."""
        loads = state.pressure_gauge_mpa, state.gravity_factor
        force = self.forces_n(state.positions_mm, *loads, state.contact)[self.mesh.points_mm[:, 2] == 0.0]
        return _HALVES * force.sum(axis=0) * (1.0, 0.0, 1.0)

    def _state(
        self, x: NDArray[np.float64], pressure_gauge_mpa: float, gravity_factor: float, memory: ContactMemory | None
    ) -> MuscleState:
        push = np.zeros(3)
        if memory is not None and self._contact is not None:
            push = -_HALVES * self._contact.pushes_n(x, memory).sum(axis=0) * (1.0, 0.0, 1.0)
        return MuscleState(
            pressure_gauge_mpa=float(pressure_gauge_mpa),
            gravity_factor=float(gravity_factor),
            tip_angle_rad=float(self.frames.angles_rad(x)[-1]),
            gas_volume_mm3=_HALVES * self._gas.value(x),
            plate_force_n=push,
            positions_mm=x,
            contact=memory,
        )
