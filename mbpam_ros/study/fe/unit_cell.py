"""The muscle's unit cell in pure bending: finite elements between two planes that stay plane.

In a long uniform wave the crest and valley planes are mirror planes. The cell is held between z = 0, on which its
nodes slide, and an end plane that turns by phi about y through a point of the z axis, at z = length + w; nodes slide
on it too. The cell's equilibria are the stationary points of the potential [N mm]

    Pi(q) = W(x(q)) - sum_c p_c V_c(x(q)) - M phi,   q = (free nodal coordinates, phi, w),

with W the elastic energy and V_c the gas volume up to the end plane (:mod:`~mbpam_ros.study.fe.chamber_volume`); dPi/dw
= 0 says that no axial force acts beyond the gas thrust. A node of the end plane lies at

    x = (0, 0, length + w) + xi e1(phi) + eta e_y,   e1 = (cos phi, 0, sin phi).

phi > 0 turns the end away from +x, the side of the pressurised chambers. The cell is symmetric about y = 0; all values
a user sees are those of the whole section. Lengths in mm, forces in N, stresses and pressures in MPa.

Not modelled: contact of the wall with itself or with another chamber's wall, viscosity, and the section's weight.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csr_matrix

from mbpam_ros.study.fe.chamber_volume import ChamberVolume
from mbpam_ros.study.fe.material import Silicone
from mbpam_ros.study.fe.mesh import CellGeometry, Resolution, unit_cell_mesh
from mbpam_ros.study.fe.solid_body import SolidBody
from mbpam_ros.study.fe.solve import LinearSolver, LoadStepError, StepControl, follow_load, linear_solver

_HALVES = 2.0  # the model is half the section

# What the half section holds of the chambers, counted so that the two halves make the whole.
_PRESSURISED = {"pdc": {1: 1.0}, "psc": {1: 1.0}}


@dataclass(frozen=True, eq=False)
class CellState:
    """An equilibrium of the cell.

    Args:
        pressure_gauge_mpa: in the pressurised chambers.
        angle_rad: phi, between the cell's two planes.
        moment_n_mm: that must act on the end plane beyond the gas thrust to hold it so; 0 in free bend.
        axis_stretch: length of the muscle's axis over its length at rest, taken as an arc.
        gas_volume_mm3: of all pressurised chambers in the cell.
        unknowns: q.
    """

    pressure_gauge_mpa: float
    angle_rad: float
    moment_n_mm: float
    axis_stretch: float
    gas_volume_mm3: float
    unknowns: NDArray[np.float64]


class UnitCell:
    """Finite element model of a cell of ``half_waves`` half waves.

    Args:
        geometry, resolution: see :mod:`~mbpam_ros.study.fe.mesh`.
        pattern: ``pdc`` (two adjacent chambers under pressure) or ``psc`` (one).
        silicone: the material's constants.
        half_waves: number of half waves; one is enough.
        solve: sparse solver; by default the fastest one installed.
        control: of the load steps.

    Raises:
        ValueError: unknown pattern.
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
    ) -> None:
        self.geometry = geometry
        self.pattern = pattern
        self.resolution = resolution or Resolution()
        self.silicone = silicone or Silicone()
        self.half_waves = half_waves
        self.mesh = unit_cell_mesh(geometry, self.resolution, pattern, half_waves)
        self._solve = solve or linear_solver()
        self._control = control or StepControl()
        self._body = SolidBody(self.mesh.points_mm, self.mesh.cells, self.silicone)
        cover_node = len(self.mesh.points_mm)
        self._gas = {
            chamber: ChamberVolume(self.mesh.faces[chamber], self.mesh.rims[chamber], cover_node)
            for chamber in _PRESSURISED[pattern]
        }
        self._last_forces: tuple = (None, np.zeros(0))
        self._number_unknowns()

    @property
    def angle_per_muscle(self) -> float:
        """Number of cells in the active length: the muscle's bend over the cell's."""
        return 2.0 * self.geometry.wave_count / self.half_waves

    @property
    def unknown_count(self) -> int:
        """Number of unknowns, phi and w being the last two."""
        return self._count

    def rest(self) -> CellState:
        """Return the state without pressure and bend."""
        return self._state(self._rest.copy(), 0.0)

    def free_bend(self, pressure_gauge_mpa: float, start: CellState | None = None) -> CellState:
        """Return the equilibrium without outer moment, following the pressure from ``start`` (default: at rest).

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
            )
        except LoadStepError as error:
            reached = 1e3 * pressure(error.reached)
            raise LoadStepError(f"free bend stopped at {reached:.2f} kPa: {error}", reached) from error
        return self._state(unknowns, pressure_gauge_mpa)

    def held_bend(self, pressure_gauge_mpa: float, angle_rad: float, start: CellState | None = None) -> CellState:
        """Return the equilibrium with the end plane held at ``angle_rad``, free to move along the axis.

        Pressure and angle go there from ``start`` together.

        Raises:
            LoadStepError: the state could not be reached.
        """
        start = start or self.rest()
        begin_pressure, begin_angle = start.pressure_gauge_mpa, start.angle_rad
        kept = np.delete(np.arange(self._count), self._count - 2)

        def pressure(load: float) -> float:
            return begin_pressure + load * (pressure_gauge_mpa - begin_pressure)

        def unknowns_at(kept_values: NDArray[np.float64], load: float) -> NDArray[np.float64]:
            angle = begin_angle + load * (angle_rad - begin_angle)
            return np.concatenate([kept_values[:-1], [angle], kept_values[-1:]])

        try:
            found = follow_load(
                lambda q, load: self.forces(unknowns_at(q, load), pressure(load))[kept],
                lambda q, load: self.tangent(unknowns_at(q, load), pressure(load))[kept][:, kept],
                start.unknowns[kept],
                self._solve,
                self._control,
            )
        except LoadStepError as error:
            part = error.reached
            raise LoadStepError(
                f"held bend stopped at {1e3 * pressure(part):.2f} kPa, "
                f"{begin_angle + part * (angle_rad - begin_angle):.4f} rad: {error}",
                part,
            ) from error
        return self._state(unknowns_at(found, 1.0), pressure_gauge_mpa)

    def positions_mm(self, unknowns: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the deformed nodes, and the centre of the end plane as the last row; shape (nodes + 1, 3)."""
        angle, height = unknowns[-2], self.mesh.length_mm + unknowns[-1]
        flat = self._fixed.copy()
        flat[self._free] = unknowns[:-2]
        x = flat.reshape(-1, 3)
        end, reach = self._end_nodes, x[self._end_nodes, 0]
        x[end, 0] = reach * math.cos(angle)
        x[end, 2] = height + reach * math.sin(angle)
        x[-1] = (0.0, 0.0, height)
        return x

    def gas_volume_mm3(self, unknowns: NDArray[np.float64]) -> float:
        """Return the volume of the pressurised chambers of the whole section."""
        x = self.positions_mm(unknowns)
        return _HALVES * sum(gas.value(x) for gas in self._gas.values())

    def potential_n_mm(self, unknowns: NDArray[np.float64], pressure_gauge_mpa: float) -> float:
        """Return Pi of the half section [N mm], without outer moment."""
        x = self.positions_mm(unknowns)
        return self._body.energy(x[:-1]) - 0.5 * pressure_gauge_mpa * self.gas_volume_mm3(unknowns)

    def forces(self, unknowns: NDArray[np.float64], pressure_gauge_mpa: float) -> NDArray[np.float64]:
        """Return dPi/dq of the half section; the last two are the moment [N mm] and the axial force [N]."""
        x = self.positions_mm(unknowns)
        return self._jacobian(unknowns).T @ self._nodal_forces(x, pressure_gauge_mpa)

    def tangent(self, unknowns: NDArray[np.float64], pressure_gauge_mpa: float) -> csr_matrix:
        """Return d2Pi/dq2 of the half section."""
        x = self.positions_mm(unknowns)
        size = x.size
        stiffness = self._body.tangent(x[:-1])
        stiffness.resize((size, size))
        for gas in self._gas.values():
            values, rows, columns = gas.hessian_entries(x)
            stiffness = stiffness - coo_matrix((pressure_gauge_mpa * values, (rows, columns)), (size, size)).tocsr()
        jacobian = self._jacobian(unknowns)
        return (jacobian.T @ stiffness @ jacobian + self._curvature(unknowns, x, pressure_gauge_mpa)).tocsr()

    def _nodal_forces(self, x: NDArray[np.float64], pressure_gauge_mpa: float) -> NDArray[np.float64]:
        """dPi/dx; the last answer is kept, because the tangent needs what the residual has just computed."""
        place, force = self._last_forces
        if place is not None and place[1] == pressure_gauge_mpa and np.array_equal(place[0], x):
            return force
        force = np.zeros_like(x)
        force[:-1] = self._body.forces(x[:-1])
        for gas in self._gas.values():
            force -= pressure_gauge_mpa * gas.gradient(x)
        self._last_forces = (x, pressure_gauge_mpa), force.ravel()
        return self._last_forces[1]

    def _number_unknowns(self) -> None:
        """Choose the free coordinates. Of an end node, x stands for xi and y for eta; its z is not free."""
        points = np.vstack([self.mesh.points_mm, [0.0, 0.0, self.mesh.length_mm]])
        free = np.ones(points.shape, dtype=bool)
        free[points[:, 1] == 0.0, 1] = False
        free[points[:, 2] == 0.0, 2] = False
        on_end = np.isclose(points[:, 2], self.mesh.length_mm)
        free[on_end, 2] = False
        free[-1] = False
        centre = np.flatnonzero(~points.any(axis=1))[0]
        free[centre, 0] = False  # both planes let the cell slide along x: its place there means nothing
        self._free = np.flatnonzero(free.ravel())
        self._fixed = points.ravel().copy()
        self._end_nodes = np.flatnonzero(on_end[:-1])
        self._count = self._free.size + 2
        self._rest = np.concatenate([self._fixed[self._free], [0.0, 0.0]])
        self._column = np.full(points.size, -1)
        self._column[self._free] = np.arange(self._free.size)

        inner = np.setdiff1d(self._free, 3 * self._end_nodes)  # dx/dq = 1; an end node's y is among them
        self._unit_rows, self._unit_columns = inner, self._column[inner]
        # A node on the end plane's centre line x = 0 may be pinned nowhere: every end node has a free xi.
        self._end_columns = self._column[3 * self._end_nodes]

    def _jacobian(self, unknowns: NDArray[np.float64]) -> csr_matrix:
        """dx/dq, shape (3 (nodes + 1), unknowns)."""
        angle, angle_column, height_column = unknowns[-2], self._count - 2, self._count - 1
        cosine, sine = math.cos(angle), math.sin(angle)
        reach = unknowns[self._end_columns]
        x_rows, z_rows = 3 * self._end_nodes, 3 * self._end_nodes + 2
        ones = np.ones(reach.size)
        entries = [
            (np.ones(self._unit_rows.size), self._unit_rows, self._unit_columns),
            (cosine * ones, x_rows, self._end_columns),
            (sine * ones, z_rows, self._end_columns),
            (-sine * reach, x_rows, np.full(reach.size, angle_column)),
            (cosine * reach, z_rows, np.full(reach.size, angle_column)),
            (ones, z_rows, np.full(reach.size, height_column)),
            (np.ones(1), np.array([self._fixed.size - 1]), np.array([height_column])),
        ]
        values, rows, columns = (np.concatenate(parts) for parts in zip(*entries, strict=True))
        return coo_matrix((values, (rows, columns)), (self._fixed.size, self._count)).tocsr()

    def _curvature(self, unknowns: NDArray[np.float64], x: NDArray[np.float64], pressure: float) -> csr_matrix:
        """sum f d2x/dq2: the end nodes' places are nonlinear in phi."""
        angle, column = unknowns[-2], self._count - 2
        force = self._nodal_forces(x, pressure).reshape(-1, 3)[self._end_nodes]
        cosine, sine = math.cos(angle), math.sin(angle)
        reach = unknowns[self._end_columns]
        mixed = -sine * force[:, 0] + cosine * force[:, 2]
        turned = -np.sum(reach * (cosine * force[:, 0] + sine * force[:, 2]))
        angles = np.full(reach.size, column)
        values = np.concatenate([mixed, mixed, [turned]])
        rows = np.concatenate([self._end_columns, angles, [column]])
        columns = np.concatenate([angles, self._end_columns, [column]])
        return coo_matrix((values, (rows, columns)), (self._count, self._count)).tocsr()

    def _state(self, unknowns: NDArray[np.float64], pressure_gauge_mpa: float) -> CellState:
        angle, height = float(unknowns[-2]), self.mesh.length_mm + float(unknowns[-1])
        arc = height if abs(angle) < 1e-9 else angle * height / math.tan(angle)
        return CellState(
            pressure_gauge_mpa=pressure_gauge_mpa,
            angle_rad=angle,
            moment_n_mm=_HALVES * float(self.forces(unknowns, pressure_gauge_mpa)[-2]),
            axis_stretch=arc / self.mesh.length_mm,
            gas_volume_mm3=self.gas_volume_mm3(unknowns),
            unknowns=unknowns,
        )
