"""The muscle's unit cell in pure bending: finite elements between two planes that stay plane.

In a long uniform wave the crest and valley planes are mirror planes. The cell is held between z = 0, on which its
nodes slide, and an end plane through a point of the z axis, at z = length + w, that turns by psi about x and then by
phi about y; nodes slide on it too. The cell's equilibria are the stationary points of the potential [N mm]

    Pi(q) = W(x(q)) + E(x(q)) - sum_c p_c V_c(x(q)) - M phi - N psi,   q = (free nodal coordinates, phi, psi, w),

with W the elastic energy, E that of arms on the wall of chambers without pressure, if contact is asked for
(:mod:`~mbpam_ros.study.fe.self_contact`), V_c the gas volume up to the end plane
(:mod:`~mbpam_ros.study.fe.chamber_volume`) and p_c = share_c p the pressure of chamber c; dPi/dw = 0 says that no axial
force acts beyond the gas thrust. A node of the end plane lies at

    x = (0, 0, length + w) + xi e1 + eta e2,   (e1, e2, n) = R_y(-phi) R_x(psi).

phi > 0 turns the end away from +x, psi > 0 away from +y. A half section is symmetric about y = 0 and has no psi; all
values a user sees are those of the whole section. Lengths in mm, forces in N, stresses and pressures in MPa.

Not modelled: contact of neighbouring folds (:meth:`UnitCell.clearance` tells how near they come), viscosity, and the
section's weight.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csr_matrix

from mbpam_ros.study.fe.chamber_volume import ChamberVolume
from mbpam_ros.study.fe.material import Silicone
from mbpam_ros.study.fe.mesh import CONVERGED, CellGeometry, Resolution, unit_cell_mesh
from mbpam_ros.study.fe.self_contact import Clearance, SelfContact, clearance
from mbpam_ros.study.fe.solid_body import SolidBody
from mbpam_ros.study.fe.solve import LinearSolver, LoadStepError, StepControl, follow_load, linear_solver

_COPIES = {"pdc": 2.0, "psc": 2.0, "full": 1.0}  # of the model in the whole section


@dataclass(frozen=True, eq=False)
class CellState:
    """An equilibrium of the cell.

    Args:
        pressure_gauge_mpa: p, in the chambers whose share is 1.
        angle_rad, side_angle_rad: phi and psi, between the cell's two planes.
        moment_n_mm, side_moment_n_mm: M and N that must act on the end plane beyond the gas thrust to hold it so; 0 in
            free bend, N also by the symmetry of a half section.
        axis_stretch: length of the muscle's axis over its length at rest, taken as an arc.
        gas_volume_mm3: of all pressurised chambers in the cell.
        unknowns: q.
    """

    pressure_gauge_mpa: float
    angle_rad: float
    side_angle_rad: float
    moment_n_mm: float
    side_moment_n_mm: float
    axis_stretch: float
    gas_volume_mm3: float
    unknowns: NDArray[np.float64]


class UnitCell:
    """Finite element model of a cell of ``half_waves`` half waves.

    Args:
        geometry, resolution: see :mod:`~mbpam_ros.study.fe.mesh`.
        pattern: section that is meshed: ``pdc`` and ``psc`` are halves, mirrored between and through chambers; ``full``
            has no symmetry. The muscle of ``psc`` is turned by -45 deg (:mod:`~mbpam_ros.study.fe.mesh`).
        silicone: the material's constants.
        half_waves: number of half waves; one is enough.
        solve: sparse solver; by default the fastest one installed.
        control: of the load steps.
        shares: pressure of each meshed chamber over p; the mirror images have the same. By default 1 in chamber 1.
        self_contact: let the cross's arms come to rest on the wall of chambers without pressure; else they pass
            through it.

    Raises:
        ValueError: unknown pattern, or a share for a chamber that is not in the mesh.
    """

    def __init__(
        self,
        geometry: CellGeometry,
        pattern: str = "pdc",
        resolution: Resolution | None = None,
        silicone: Silicone | None = None,
        half_waves: int = 1,
        solve: LinearSolver | None = None,
        control: StepControl | None = None,
        shares: Mapping[int, float] | None = None,
        self_contact: bool = False,
    ) -> None:
        self.geometry = geometry
        self.pattern = pattern
        self.resolution = resolution or CONVERGED
        self.silicone = silicone or Silicone()
        self.half_waves = half_waves
        self.mesh = unit_cell_mesh(geometry, self.resolution, pattern, half_waves)
        self._solve = solve or linear_solver()
        self._control = control or StepControl()
        self._body = SolidBody(self.mesh.points_mm, self.mesh.cells, self.silicone)
        self._shares = {1: 1.0} if shares is None else {chamber: share for chamber, share in shares.items() if share}
        foreign = set(self._shares) - set(self.mesh.faces)
        if foreign:
            raise ValueError(f"section {pattern!r} holds chambers {sorted(self.mesh.faces)}, not {sorted(foreign)}")
        cover_node = len(self.mesh.points_mm)
        self._gas = {
            chamber: ChamberVolume(self.mesh.faces[chamber], self.mesh.rims[chamber], cover_node)
            for chamber in self._shares
        }
        self._contact = SelfContact(self.mesh, self.mesh.faces.keys() - self._shares) if self_contact else None
        self._copies = _COPIES[pattern]
        self._last_forces: tuple = (None, np.zeros(0))
        self._number_unknowns()

    @property
    def angle_per_muscle(self) -> float:
        """Number of cells in the active length: the muscle's bend over the cell's."""
        return 2.0 * self.geometry.wave_count / self.half_waves

    @property
    def copies(self) -> float:
        """Number of meshed sections in the whole one."""
        return self._copies

    @property
    def unknown_count(self) -> int:
        """Number of unknowns; the last ones are phi, in the full section psi, and w."""
        return self._count

    def rest(self) -> CellState:
        """Return the state without pressure and bend."""
        return self._state(self._rest.copy(), 0.0)

    def free_bend(
        self, pressure_gauge_mpa: float, start: CellState | None = None, earlier: Sequence[CellState] = ()
    ) -> CellState:
        """Return the equilibrium without outer moment, following the pressure from ``start`` (default: at rest).

        Args:
            pressure_gauge_mpa: where to.
            start: a free state.
            earlier: free states on the way to ``start``, to begin from a better guess.

        Raises:
            LoadStepError: the pressure could not be reached.
        """
        start = start or self.rest()
        begin = start.pressure_gauge_mpa

        def pressure(load: float) -> float:
            return begin + load * (pressure_gauge_mpa - begin)

        try:
            unknowns = follow_load(
                lambda q, load: self.forces(q, pressure(load)),
                lambda q, load: self.tangent(q, pressure(load)),
                start.unknowns,
                self._solve,
                self._control,
                earlier=[
                    ((state.pressure_gauge_mpa - begin) / (pressure_gauge_mpa - begin), state.unknowns)
                    for state in earlier
                ],
            )
        except LoadStepError as error:
            reached = 1e3 * pressure(error.reached)
            raise LoadStepError(f"free bend stopped at {reached:.2f} kPa: {error}", reached) from error
        return self._state(unknowns, pressure_gauge_mpa)

    def held_bend(
        self,
        pressure_gauge_mpa: float,
        angle_rad: float,
        start: CellState | None = None,
        earlier: Sequence[CellState] = (),
        control: StepControl | None = None,
    ) -> CellState:
        """Return the equilibrium with the end plane held at phi = ``angle_rad``, psi = 0, free to move along the axis.

        Args:
            pressure_gauge_mpa, angle_rad: where to, both together.
            start: where from; by default at rest.
            earlier: states of the same pressure, to begin from a better guess; the last one is nearest.
            control: of the load steps; by default the cell's.

        Raises:
            LoadStepError: the state could not be reached.
        """
        start = start or self.rest()
        begin_pressure, begin = start.pressure_gauge_mpa, start.unknowns[self._angles]
        end = np.append(angle_rad, np.zeros(begin.size - 1))
        kept = np.delete(np.arange(self._count), self._angles)

        def pressure(load: float) -> float:
            return begin_pressure + load * (pressure_gauge_mpa - begin_pressure)

        def unknowns_at(kept_values: NDArray[np.float64], load: float) -> NDArray[np.float64]:
            return np.concatenate([kept_values[:-1], begin + load * (end - begin), kept_values[-1:]])

        try:
            found = follow_load(
                lambda q, load: self.forces(unknowns_at(q, load), pressure(load))[kept],
                lambda q, load: self.tangent(unknowns_at(q, load), pressure(load))[kept][:, kept],
                start.unknowns[kept],
                self._solve,
                control or self._control,
                earlier=[
                    ((state.angle_rad - begin[0]) / (angle_rad - begin[0]), state.unknowns[kept]) for state in earlier
                ],
            )
        except LoadStepError as error:
            part = error.reached
            raise LoadStepError(
                f"held bend stopped at {1e3 * pressure(part):.2f} kPa, "
                f"{begin[0] + part * (angle_rad - begin[0]):.4f} rad: {error}",
                part,
            ) from error
        return self._state(unknowns_at(found, 1.0), pressure_gauge_mpa)

    def positions_mm(self, unknowns: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the deformed nodes, and the centre of the end plane as the last row; shape (nodes + 1, 3)."""
        x = self._flat(unknowns)
        centre = np.array([0.0, 0.0, self.mesh.length_mm + unknowns[-1]])
        x[self._end_nodes] = centre + x[self._end_nodes, :2] @ self._end_axes(unknowns).T
        x[-1] = centre
        return x

    def gas_volume_mm3(self, unknowns: NDArray[np.float64]) -> float:
        """Return the volume of the pressurised chambers of the whole section."""
        x = self.positions_mm(unknowns)
        return self._copies * sum(gas.value(x) for gas in self._gas.values())

    def clearance(self, state: CellState) -> Clearance:
        """Return how near folds and walls come to touching."""
        normal = np.cross(*self._end_axes(state.unknowns).T)
        return clearance(self.mesh, self.positions_mm(state.unknowns), normal, self._shares.keys())

    def largest_principal(self, state: CellState) -> tuple[NDArray[np.float64], ...]:
        """Return the largest principal stretch and true stress [MPa], and the volume at rest [mm3], of each point.

        As :meth:`~mbpam_ros.study.fe.solid_body.SolidBody.largest_principal`.
        """
        return self._body.largest_principal(self.positions_mm(state.unknowns)[:-1])

    def section_turn_rad(self, unknowns: NDArray[np.float64]) -> float:
        """Return by how much the section at z = 0 is turned about z, least squares over its nodes.

        The full section is kept from turning by one node only, which moves as its surroundings do; directions count
        from the section. A half section does not turn.
        """
        if self.pattern != "full":
            return 0.0
        rest, now = (x[self.mesh.points_mm[:, 2] == 0.0, :2] for x in (self.mesh.points_mm, self._flat(unknowns)[:-1]))
        turn = (rest - rest.mean(axis=0)).T @ (now - now.mean(axis=0))
        return math.atan2(turn[0, 1] - turn[1, 0], turn[0, 0] + turn[1, 1])

    def potential_n_mm(self, unknowns: NDArray[np.float64], pressure_gauge_mpa: float) -> float:
        """Return Pi of the meshed section [N mm], without outer moment."""
        x = self.positions_mm(unknowns)
        work = sum(self._shares[chamber] * gas.value(x) for chamber, gas in self._gas.items())
        energy = self._body.energy(x[:-1]) + (self._contact.energy(x) if self._contact else 0.0)
        return energy - pressure_gauge_mpa * work

    def forces(self, unknowns: NDArray[np.float64], pressure_gauge_mpa: float) -> NDArray[np.float64]:
        """Return dPi/dq of the meshed section; the last ones are the moments [N mm] and the axial force [N]."""
        x = self.positions_mm(unknowns)
        return self._jacobian(unknowns).T @ self._nodal_forces(x, pressure_gauge_mpa)

    def nodal_forces(self, x: NDArray[np.float64], pressure_gauge_mpa: float) -> NDArray[np.float64]:
        """Return dPi/dx [N] of the meshed section, nodes as in :meth:`positions_mm`, shape (nodes + 1, 3)."""
        return self._nodal_forces(x, pressure_gauge_mpa).reshape(-1, 3)

    def to_unknowns(self, unknowns: NDArray[np.float64], forces: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return what nodal forces, shape (nodes + 1, 3), do on the unknowns: their virtual work for each."""
        return self._jacobian(unknowns).T @ forces.ravel()

    def tangent(self, unknowns: NDArray[np.float64], pressure_gauge_mpa: float) -> csr_matrix:
        """Return d2Pi/dq2 of the meshed section."""
        x = self.positions_mm(unknowns)
        stiffness = self.nodal_stiffness(x, pressure_gauge_mpa)
        jacobian = self._jacobian(unknowns)
        return (jacobian.T @ stiffness @ jacobian + self._curvature(unknowns, x, pressure_gauge_mpa)).tocsr()

    def nodal_stiffness(self, x: NDArray[np.float64], pressure_gauge_mpa: float) -> csr_matrix:
        """Return d2Pi/dx2 [N/mm] of the meshed section over 3 node + component, nodes as in :meth:`positions_mm`."""
        size = x.size
        stiffness = self._body.tangent(x[:-1])
        stiffness.resize((size, size))
        for chamber, gas in self._gas.items():
            values, rows, columns = gas.hessian_entries(x)
            values = self._shares[chamber] * pressure_gauge_mpa * values
            stiffness = stiffness - coo_matrix((values, (rows, columns)), (size, size)).tocsr()
        if self._contact:
            stiffness = stiffness + self._contact.tangent(x)
        return stiffness

    def nodal_volumes_mm3(self) -> NDArray[np.float64]:
        """Return each node's share of the silicone at rest, shape (nodes,)."""
        return self._body.nodal_volumes_mm3(np.ones(len(self.mesh.cells)))

    def _nodal_forces(self, x: NDArray[np.float64], pressure_gauge_mpa: float) -> NDArray[np.float64]:
        """dPi/dx; the last answer is kept, because the tangent needs what the residual has just computed."""
        place, force = self._last_forces
        if place is not None and place[1] == pressure_gauge_mpa and np.array_equal(place[0], x):
            return force
        force = np.zeros_like(x)
        force[:-1] = self._body.forces(x[:-1])
        for chamber, gas in self._gas.items():
            force -= self._shares[chamber] * pressure_gauge_mpa * gas.gradient(x)
        if self._contact:
            force += self._contact.forces(x)
        self._last_forces = (x, pressure_gauge_mpa), force.ravel()
        return self._last_forces[1]

    def _number_unknowns(self) -> None:
        """Choose the free coordinates. Of an end node, x stands for xi and y for eta; its z is not free."""
        points = np.vstack([self.mesh.points_mm, [0.0, 0.0, self.mesh.length_mm]])
        free = np.ones(points.shape, dtype=bool)
        free[points[:, 2] == 0.0, 2] = False
        on_end = np.isclose(points[:, 2], self.mesh.length_mm)
        free[on_end, 2] = False
        free[-1] = False
        centre = np.flatnonzero(~points.any(axis=1))[0]
        free[centre, 0] = False  # both planes let the cell slide along x: its place there means nothing
        if self.pattern == "full":
            free[centre, 1] = False
            free[self._core_node(points), 1] = False  # nor does its azimuth (see section_turn_rad)
        else:
            free[points[:, 1] == 0.0, 1] = False
        self._free = np.flatnonzero(free.ravel())
        self._fixed = points.ravel().copy()
        self._end_nodes = np.flatnonzero(on_end[:-1])
        self._count = self._free.size + (3 if self.pattern == "full" else 2)
        self._angles = np.arange(self._free.size, self._count - 1)
        self._rest = np.concatenate([self._fixed[self._free], np.zeros(self._count - self._free.size)])
        column = np.full(points.shape, -1)
        column.ravel()[self._free] = np.arange(self._free.size)
        self._end_columns = column[self._end_nodes, :2]  # of xi and eta; -1 = not free
        self._unit_rows = np.setdiff1d(self._free, 3 * self._end_nodes[:, None] + [0, 1])  # dx/dq = 1
        self._unit_columns = column.ravel()[self._unit_rows]

    def _core_node(self, points: NDArray[np.float64]) -> int:
        """The node at z = 0, in the middle of the cross, on the positive x axis."""
        return int(np.flatnonzero(np.isclose(points, [0.5 * self.geometry.b_mm, 0.0, 0.0]).all(axis=1))[0])

    def _flat(self, unknowns: NDArray[np.float64]) -> NDArray[np.float64]:
        """Nodes as numbered: the first two components of end nodes are xi and eta."""
        flat = self._fixed.copy()
        flat[self._free] = unknowns[: self._free.size]
        return flat.reshape(-1, 3)

    def _end_axes(self, unknowns: NDArray[np.float64], d_angle: int = 0, d_side: int = 0) -> NDArray[np.float64]:
        """(e1, e2) as columns, or their derivatives of these orders with respect to phi and psi."""
        phi, psi = (*unknowns[self._angles], 0.0)[:2]
        c, s = math.cos(phi + 0.5 * math.pi * d_angle), math.sin(phi + 0.5 * math.pi * d_angle)
        about_y = np.array([[c, 0.0, -s], [0.0, 0.0 if d_angle else 1.0, 0.0], [s, 0.0, c]])
        c, s = math.cos(psi + 0.5 * math.pi * d_side), math.sin(psi + 0.5 * math.pi * d_side)
        return about_y @ np.array([[0.0 if d_side else 1.0, 0.0], [0.0, c], [0.0, s]])

    def _jacobian(self, unknowns: NDArray[np.float64]) -> csr_matrix:
        """dx/dq, shape (3 (nodes + 1), unknowns)."""
        reach = self._flat(unknowns)[self._end_nodes, :2]
        axes = self._end_axes(unknowns)
        rows = 3 * self._end_nodes[:, None] + np.arange(3)  # (end nodes, 3)
        entries = [
            (np.ones(self._unit_rows.size), self._unit_rows, self._unit_columns),
            (np.ones(len(rows)), rows[:, 2], np.full(len(rows), self._count - 1)),
            (np.ones(1), np.array([self._fixed.size - 1]), np.array([self._count - 1])),
        ]
        for component in range(2):
            free = self._end_columns[:, component] >= 0
            place, columns = rows[free], self._end_columns[free, component]
            entries.append((np.tile(axes[:, component], len(place)), place.ravel(), np.repeat(columns, 3)))
        for column, order in zip(self._angles, ((1, 0), (0, 1)), strict=False):
            turned = reach @ self._end_axes(unknowns, *order).T
            entries.append((turned.ravel(), rows.ravel(), np.full(rows.size, column)))
        values, rows, columns = (np.concatenate(parts) for parts in zip(*entries, strict=True))
        return coo_matrix((values, (rows, columns)), (self._fixed.size, self._count)).tocsr()

    def _curvature(self, unknowns: NDArray[np.float64], x: NDArray[np.float64], pressure: float) -> csr_matrix:
        """Sum f d2x/dq2: the end nodes' places are nonlinear in the angles."""
        force = self._nodal_forces(x, pressure).reshape(-1, 3)[self._end_nodes]
        reach = self._flat(unknowns)[self._end_nodes, :2]
        orders = ((1, 0), (0, 1))[: self._angles.size]
        values: list[NDArray[np.float64]] = []
        rows: list[NDArray[np.int64]] = []
        columns: list[NDArray[np.int64]] = []
        for angle, order in zip(self._angles, orders, strict=True):
            mixed = force @ self._end_axes(unknowns, *order)  # (end nodes, xi and eta)
            free = self._end_columns >= 0
            values += [mixed[free], mixed[free]]
            rows += [self._end_columns[free], np.full(free.sum(), angle)]
            columns += [np.full(free.sum(), angle), self._end_columns[free]]
            for other, more in zip(self._angles, orders, strict=True):
                turned = self._end_axes(unknowns, order[0] + more[0], order[1] + more[1])
                values.append(np.array([np.sum(force * (reach @ turned.T))]))
                rows.append(np.array([angle]))
                columns.append(np.array([other]))
        places = np.concatenate(rows), np.concatenate(columns)
        return coo_matrix((np.concatenate(values), places), (self._count, self._count)).tocsr()

    def _state(self, unknowns: NDArray[np.float64], pressure_gauge_mpa: float) -> CellState:
        height = self.mesh.length_mm + float(unknowns[-1])
        angle, side_angle = (*map(float, unknowns[self._angles]), 0.0)[:2]
        moment, side_moment = (*map(float, self.forces(unknowns, pressure_gauge_mpa)[self._angles]), 0.0)[:2]
        tilt = math.acos(min(1.0, math.cos(angle) * math.cos(side_angle)))
        arc = height if tilt < 1e-7 else tilt * height / math.tan(tilt)
        return CellState(
            pressure_gauge_mpa=pressure_gauge_mpa,
            angle_rad=angle,
            side_angle_rad=side_angle,
            moment_n_mm=self._copies * moment,
            side_moment_n_mm=self._copies * side_moment,
            axis_stretch=arc / self.mesh.length_mm,
            gas_volume_mm3=self.gas_volume_mm3(unknowns),
            unknowns=unknowns,
        )
