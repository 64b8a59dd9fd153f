"""Stiffness of the muscle's section against small changes of bend, side bend, twist and stretch, from the unit cell.

At an equilibrium of a half section without axial force the cell's potential, least over all that is inside, is expanded
to second order in the strains of the axis: curvatures kappa in and kappa_s across the bending plane, twist tau and
stretch eps, all per unstretched length l of the cell. Over the whole section

    Pi = const + l (M kappa' + 1/2 (kappa', kappa_s, tau, eps) K (kappa', kappa_s, tau, eps)^T),

with kappa' the change of kappa. Sections are free to warp. The symmetries make K block diagonal: in the mirror y = 0
kappa_s and tau change sign, in the mirror planes through crests and valleys tau alone. So twist is coupled with nothing
(in the section without a mirror plane, too), and three problems are left, of the half section and half a wave:

    kappa and eps:  the cell's own unknowns phi and w;
    kappa_s:        fields odd in y; the end plane stays plane and turns with the axis;
    tau:            fields odd in y and in the planes: in them nodes move along the normal only (they warp), but for the
                    rigid motion of the plane with the axis.

The axis of constant strain s -> (R, r) is that of the rod, R' = R [kappa]x, r' = (1 + eps) R e_z, through the centre of
the crest (Kirchhoff: no shear). Axial force, side moment and torque are not in balance by themselves where the axis is
bent: per length they need the force kappa N sideways, the couples kappa T and kappa M_s about the other axes (the rod
gets them from shear force and from its own turning). These act on the cell as body forces, spread as the silicone is,
the couples as forces proportional to the distance. The shear force itself is zero, so its compliance is not part of
these stiffnesses. Where the section is held by a moment M, second order terms of its end plane's motion count too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csr_matrix

from mbpam_ros.study.fe.solve import LinearSolver, linear_solver
from mbpam_ros.study.fe.unit_cell import CellState, UnitCell

_SMALL_RAD = 1e-4  # below it the series' first terms are exact to 1e-9


@dataclass(frozen=True)
class SectionStiffness:
    """Entries of K at an equilibrium, those that symmetry does not make zero; of the whole section.

    Args:
        bend_n_mm2: d M / d kappa with the axial force kept (at zero): the slope of the law M(kappa).
        side_bend_n_mm2: d M_s / d kappa_s.
        torsion_n_mm2: GJ = d T / d tau.
        axial_n: EA = d N / d eps at held curvature.
        stretch_per_curvature_mm: d eps / d kappa without axial force; the coupling d N / d kappa is -EA times it.
    """

    bend_n_mm2: float
    side_bend_n_mm2: float
    torsion_n_mm2: float
    axial_n: float
    stretch_per_curvature_mm: float


def section_stiffness(cell: UnitCell, state: CellState, solve: LinearSolver | None = None) -> SectionStiffness:
    """Return the stiffness at ``state``.

    Args:
        cell: of half a wave and a half section.
        state: an equilibrium of it, free or held.
        solve: sparse solver, for several right-hand sides; by default the fastest one installed.

    Raises:
        ValueError: the cell is of the full section or of more than half a wave.
    """
    if cell.pattern == "full" or cell.half_waves != 1:
        raise ValueError(
            f"the stiffness is that of half a wave of a half section, not of {cell.half_waves} half waves of "
            f"{cell.pattern!r}"
        )
    solve = solve or linear_solver()
    place = _Place(cell, state)
    bend, axial, coupling = _bend_and_stretch(cell, state, place, solve)
    stiffness = cell.nodal_stiffness(place.x, state.pressure_gauge_mpa)
    return SectionStiffness(
        bend_n_mm2=bend,
        side_bend_n_mm2=_side_bend(stiffness, place, solve),
        torsion_n_mm2=_torsion(stiffness, place, solve),
        axial_n=axial,
        stretch_per_curvature_mm=coupling,
    )


class _Place:
    """The equilibrium: nodes, planes, the axis between them, what acts on the end plane. Of the meshed half section."""

    def __init__(self, cell: UnitCell, state: CellState) -> None:
        points = np.vstack([cell.mesh.points_mm, [0.0, 0.0, cell.mesh.length_mm]])
        self.length = cell.mesh.length_mm
        self.phi, self.stretch = state.angle_rad, state.axis_stretch
        self.x = cell.positions_mm(state.unknowns)
        self.mass = np.append(cell.nodal_volumes_mm3(), 0.0)
        self.at_start = points[:, 2] == 0.0
        self.at_end = np.isclose(points[:, 2], self.length)
        self.on_mirror = points[:, 1] == 0.0
        self.part = points[:, 2] / self.length  # of the axis, where a node's section sits
        self.e1 = np.array([math.cos(self.phi), 0.0, math.sin(self.phi)])
        self.normal = np.array([-math.sin(self.phi), 0.0, math.cos(self.phi)])
        force = cell.nodal_forces(self.x, state.pressure_gauge_mpa)
        self.end_push = force @ self.normal * self.at_end  # of each node of the end plane
        self.moment = float(self.end_push @ (self.x @ self.e1))
        """Half the moment that holds the section; the pushes have no sum."""

    def turn(self, strain: str) -> NDArray[np.float64]:
        """Rotation vectors of the axis at the nodes' sections for a unit strain, shape (nodes, 3)."""
        angle = self.phi * self.part
        along, across = self.length * self.part * np.sinc(angle / np.pi), self.length * self.part * _versine(angle)
        zero = np.zeros_like(along)
        if strain == "twist":
            return np.stack([-across, zero, along], axis=1)
        return np.stack([along, zero, across], axis=1)

    def field(self, strain: str) -> NDArray[np.float64]:
        """Displacements of the nodes with their rigid sections for a unit strain, shape (nodes, 3).

        Of the sections' way only the part along y is not zero, and that only slides the cell; it is left out.
        """
        angle = self.phi * self.part
        radius = self.length * self.part * self.stretch
        axis = np.stack([-radius * _versine(angle), np.zeros_like(angle), radius * np.sinc(angle / np.pi)], axis=1)
        return np.cross(self.turn(strain), self.x - axis)

    def held_moment_share(self) -> float:
        """d2/dt2 of n . R e1 at t = 0 for the axis turned by (phi, t): how far a twist tilts the held end plane."""
        phi = self.phi
        if abs(phi) < _SMALL_RAD:
            return 2.0 / 3.0 * phi
        return (phi - math.sin(phi) * math.cos(phi)) / phi**2


def _versine(angle: NDArray[np.float64]) -> NDArray[np.float64]:
    """(1 - cos) over the angle, odd and regular at zero."""
    return np.sin(0.5 * angle) * np.sinc(0.5 * angle / np.pi)


def _bend_and_stretch(
    cell: UnitCell, state: CellState, place: _Place, solve: LinearSolver
) -> tuple[float, float, float]:
    """Slope of M, EA, and d eps / d kappa; q ends with phi and w.

    The cell is kept from sliding along x at one node; a body force along x, tan(phi) times the axial one, is in balance
    with it, so that the node is not pulled.
    """
    tangent = cell.tangent(state.unknowns, state.pressure_gauge_mpa)
    phi, length = place.phi, place.length
    along = np.zeros_like(place.x)
    along[:, 0] = math.tan(phi) * place.mass / place.mass.sum()
    axial = cell.to_unknowns(state.unknowns, along)
    axial[-1] += 1.0
    moment = np.zeros_like(axial)
    moment[-2] = 1.0
    by_moment, by_force = solve(tangent, np.stack([moment, axial], axis=1)).T
    per_moment, per_force, mixed = by_moment[-2], axial @ by_force, axial @ by_moment
    shape = 1.0 / np.sinc(phi / np.pi) * math.cos(phi)  # phi / tan(phi): the arc over the height of the end plane
    height = state.axis_stretch * length / shape
    slope = -2.0 / 3.0 * phi if abs(phi) < _SMALL_RAD else 1.0 / math.tan(phi) - phi / math.sin(phi) ** 2
    stretch_per_moment = (shape * by_moment[-1] + height * slope * per_moment) / length
    bend = cell.copies * length / per_moment
    stiffness = cell.copies * length / (per_force - mixed**2 / per_moment) / shape**2
    return float(bend), float(stiffness), float(length * stretch_per_moment / per_moment)


def _side_bend(stiffness: csr_matrix, place: _Place, solve: LinearSolver) -> float:
    """Side bend stiffness: fields odd in y; nodes of the planes slide on them, turned with the axis."""
    free = np.ones(place.x.shape, dtype=bool)
    free[place.on_mirror] = False, True, False
    free[place.at_start, 2] = False
    slides = np.flatnonzero(place.at_end[:-1])
    free[place.at_end] = False
    centre, rim = _on_the_symmetry_line(place)
    free[[centre, rim], 1] = False
    sideways = np.array([0.0, 1.0, 0.0])
    moves = _Moves(free, [(slides, sideways), (slides[~place.on_mirror[slides]], place.e1)])
    turning = np.zeros_like(place.x)
    turning[rim, 1] = 1.0
    frame = np.where(place.at_end[:, None], place.field("side"), 0.0)
    middle = place.mass @ place.x[:, 0] / place.mass.sum()
    couple = np.stack(
        [-place.mass * place.x[:, 1], place.mass * (place.x[:, 0] - middle), np.zeros_like(place.mass)], axis=1
    )
    # second order: eta moves the push along the turned plane; the plane itself tilts at second order
    along_normal = math.sin(place.phi) / place.phi if abs(place.phi) > _SMALL_RAD else 1.0
    push = np.zeros_like(place.x)
    push[:, 1] = place.length * along_normal * place.end_push
    phi = place.phi
    tilt = place.held_moment_share() - 2.0 * math.sin(phi) * (
        0.5 if abs(phi) < _SMALL_RAD else (1.0 - math.cos(phi)) / phi**2
    )
    second = place.moment * tilt * place.length**2
    return (
        2.0 / place.length * _least(stiffness, moves, frame, turning, couple, place.field("side"), solve, push, second)
    )


def _torsion(stiffness: csr_matrix, place: _Place, solve: LinearSolver) -> float:
    """GJ: fields odd in y and in the planes, whose nodes move along the normal only."""
    free = np.ones(place.x.shape, dtype=bool)
    free[place.on_mirror] = False, True, False
    free[place.at_start, :2] = False
    free[place.at_end] = False
    warps = np.flatnonzero(place.at_end & ~place.on_mirror)
    moves = _Moves(free, [(warps, place.normal)])
    sliding = np.zeros_like(place.x)
    sliding[place.at_end, 1] = 1.0
    frame = np.where(place.at_end[:, None], place.field("twist"), 0.0)
    couple = np.zeros_like(place.x)
    couple[:, 2] = place.mass * place.x[:, 1]
    second = place.moment * place.held_moment_share() * place.length**2
    return (
        2.0
        / place.length
        * _least(stiffness, moves, frame, sliding, couple, place.field("twist"), solve, np.zeros_like(place.x), second)
    )


def _on_the_symmetry_line(place: _Place) -> tuple[int, int]:
    """The axis' node at z = 0, and the outermost one beside it on the mirror plane."""
    line = np.flatnonzero(place.at_start & place.on_mirror)
    return int(line[np.abs(place.x[line]).sum(axis=1).argmin()]), int(line[place.x[line, 0].argmax()])


class _Moves:
    """Displacements of free components, and of nodes along given directions, as columns over 3 node + component."""

    def __init__(self, free: NDArray[np.bool_], directed: list[tuple[NDArray[np.int64], NDArray[np.float64]]]) -> None:
        components = np.flatnonzero(free.ravel())
        values, rows = [np.ones(components.size)], [components]
        columns, count = [np.arange(components.size)], components.size
        for nodes, direction in directed:
            rows.append((3 * nodes[:, None] + np.arange(3)).ravel())
            values.append(np.tile(direction, nodes.size))
            columns.append(count + np.repeat(np.arange(nodes.size), 3))
            count += nodes.size
        places = np.concatenate(rows), np.concatenate(columns)
        self.matrix = coo_matrix((np.concatenate(values), places), (free.size, count)).tocsr()


def _least(
    stiffness: csr_matrix,
    moves: _Moves,
    frame: NDArray[np.float64],
    loose: NDArray[np.float64],
    couple: NDArray[np.float64],
    rigid: NDArray[np.float64],
    solve: LinearSolver,
    push: NDArray[np.float64],
    second: float,
) -> float:
    """Twice the least energy of a unit strain.

    The displacements are ``frame`` plus any of ``moves`` and of ``loose`` with couple . u = couple . rigid.

    Args:
        frame, loose, rigid: shape (nodes, 3).
        couple: the body forces, shape (nodes, 3); their size is found.
        push: second order energy that is bilinear in the strain and the moves.
        second: twice the second order energy of the strain alone.
    """
    basis = moves.matrix
    inner = (basis.T @ stiffness @ basis).tocsr()
    # u = basis f + a frame + b loose; energy quadratic in (f, a, b); stationary in f, b, with a multiplier
    outer = np.stack([frame.ravel(), loose.ravel()], axis=1)
    force = stiffness @ outer
    mixed = basis.T @ force
    mixed[:, 0] += basis.T @ push.ravel()
    own = outer.T @ force
    own[0, 0] += second
    bound = basis.T @ couple.ravel()
    found = solve(inner, np.column_stack([mixed, bound]))
    condensed = own - mixed.T @ found[:, :2]
    slack = couple.ravel() @ outer - bound @ found[:, :2]
    give = float(bound @ found[:, 2])
    wanted = float(couple.ravel() @ rigid.ravel()) - slack[0]
    # stationary in b and the multiplier mu: K_bb b - slack_b mu = -K_ba; slack_b b + give mu = wanted
    system = np.array([[condensed[1, 1], -slack[1]], [slack[1], give]])
    b, mu = np.linalg.solve(system, [-condensed[1, 0], wanted])
    inside = condensed[0, 0] + 2.0 * condensed[0, 1] * b + condensed[1, 1] * b**2
    return float(inside + give * mu**2)
