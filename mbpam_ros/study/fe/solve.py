"""Newton's method, adaptive load steps, and the sparse solver behind them (Pardiso, or SciPy's SuperLU without it)."""

from __future__ import annotations

import importlib.util
import math
import weakref
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import ModuleType

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix, triu
from scipy.sparse.linalg import splu

from mbpam_ros.errors import MbpamError

LinearSolver = Callable[[csr_matrix, NDArray[np.float64]], NDArray[np.float64]]
Residual = Callable[[NDArray[np.float64], float], NDArray[np.float64]]
Tangent = Callable[[NDArray[np.float64], float], "csr_matrix | UpdatedMatrix"]
Equilibrium = tuple[float, NDArray[np.float64]]
"""Load parameter and unknowns."""
Accept = Callable[[NDArray[np.float64], float], bool]
Map = Callable[[NDArray[np.float64]], NDArray[np.float64]]

SOLVERS = ("pardiso", "superlu")
_ROUNDING = 1e-9
_EXTRAPOLATED = 4  # equilibria through which the next guess is laid
_FACTORISE_AND_SOLVE = 23  # Pardiso's phases, without the first: the analysis of the pattern


class LoadStepError(MbpamError, RuntimeError):
    """The load could not be raised further. ``reached`` is the last load with an equilibrium."""

    def __init__(self, message: str, reached: float) -> None:
        super().__init__(message, reached)  # both, so that it can be pickled on its way from another process
        self.reached = reached

    def __str__(self) -> str:
        return self.args[0]


@dataclass(frozen=True, eq=False)
class UpdatedMatrix:
    """A sparse matrix minus one of low rank, K - U V^T: a load that follows the body makes such a tangent.

    Args:
        matrix: K, shape (n, n).
        left, right: U and V, shape (n, k).
    """

    matrix: csr_matrix
    left: NDArray[np.float64]
    right: NDArray[np.float64]

    def solve(self, solve: LinearSolver, right: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the solution for a right-hand side (n,), with one factorisation of K (Sherman, Morrison, Woodbury)."""
        solved = solve(self.matrix, np.column_stack([right, self.left]))
        plain, columns = solved[:, 0], solved[:, 1:]
        inner = np.eye(columns.shape[1]) - self.right.T @ columns
        return plain + columns @ np.linalg.solve(inner, self.right.T @ plain)


def linear_solver(name: str | None = None, symmetric: bool = True) -> LinearSolver:
    """Return a sparse solver: ``pardiso`` or ``superlu``; by default Pardiso if pypardiso is there.

    Args:
        symmetric: the matrices are symmetric; friction's are not, but have a symmetric pattern.

    Raises:
        ValueError: unknown name.
        ModuleNotFoundError: Pardiso was asked for and pypardiso is not installed.
    """
    if name is None:
        name = "pardiso" if importlib.util.find_spec("pypardiso") else "superlu"
    if name not in SOLVERS:
        raise ValueError(f"unknown solver {name!r}; known: {', '.join(SOLVERS)}")
    if name == "superlu":
        return _superlu
    import pypardiso  # optional

    if not symmetric:
        general = pypardiso.PyPardisoSolver(mtype=11)
        return lambda matrix, right: general.solve(matrix.sorted_indices(), right)
    return _SymmetricPardiso(pypardiso)


class _SymmetricPardiso:
    """Pardiso for symmetric, indefinite matrices.

    The order of elimination, two thirds of the work, depends on the pattern alone and is kept until that changes.
    (Pardiso looks at the values, too, for general matrices.)
    """

    def __init__(self, pypardiso: ModuleType) -> None:
        self._solver = pypardiso.PyPardisoSolver(mtype=-2)
        self._pattern: tuple[NDArray[np.int32], NDArray[np.int32]] | None = None
        self._last = csr_matrix((0, 0))
        self._upper = self._last, np.zeros(0, dtype=np.int32)
        weakref.finalize(self, self._solver.free_memory, True)

    def __call__(self, matrix: csr_matrix, right: NDArray[np.float64]) -> NDArray[np.float64]:
        upper = self._upper_triangle(matrix)
        if not self._knows(upper):
            self._solver.free_memory(True)
            self._solver.factorize(upper)
            self._pattern = upper.indptr, upper.indices
            return self._solver.solve(upper, right)
        self._solver.set_phase(_FACTORISE_AND_SOLVE)
        return self._solver._call_pardiso(upper, np.asfortranarray(right))

    def _upper_triangle(self, matrix: csr_matrix) -> csr_matrix:
        """The upper triangle; where it lies is known of a matrix that shares the last one's indices."""
        if matrix.indices is not self._last.indices or matrix.indptr is not self._last.indptr:
            places = csr_matrix((np.arange(1, matrix.nnz + 1), matrix.indices, matrix.indptr), matrix.shape)
            pattern = triu(places, format="csr").sorted_indices()
            self._last, self._upper = matrix, (pattern, pattern.data - 1)
        pattern, chosen = self._upper
        return csr_matrix((matrix.data[chosen], pattern.indices, pattern.indptr), matrix.shape)

    def _knows(self, upper: csr_matrix) -> bool:
        return self._pattern is not None and all(
            np.array_equal(known, found)
            for known, found in zip(self._pattern, (upper.indptr, upper.indices), strict=True)
        )


def _superlu(matrix: csr_matrix, right: NDArray[np.float64]) -> NDArray[np.float64]:
    """Pivots mostly on the diagonal: four times as fast for symmetric patterns as SuperLU's general mode."""
    try:
        factors = splu(
            matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.01, options={"SymmetricMode": True}
        )
    except RuntimeError:  # exactly singular
        return np.full_like(right, np.nan)
    return factors.solve(right)


@dataclass(frozen=True)
class StepControl:
    """How equilibria are found and how the load is stepped.

    Args:
        residual_n: largest force out of balance that counts as equilibrium [N].
        most_iterations: of Newton's method; then the step is halved.
        most_revisions: of a problem that says it has changed (contact); then the step is halved.
        first_step, largest_step, smallest_step: of the load parameter, which runs from 0 to 1.
    """

    residual_n: float = 1e-7
    most_iterations: int = 12
    first_step: float = 0.1
    largest_step: float = 0.25
    smallest_step: float = 1e-4
    most_revisions: int = 8


@dataclass(frozen=True)
class Chart:
    """Coordinates along whose straight lines the steps are taken, where those of the unknowns are a bad guess.

    Args:
        coordinates: of the unknowns.
        unknowns: of the coordinates; undoes ``coordinates``.
    """

    coordinates: Map
    unknowns: Map

    def moved(self, here: NDArray[np.float64], step: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the unknowns after a step that begins in the direction ``step`` and is as long."""
        longest = float(np.abs(step).max(initial=0.0))
        if not 0.0 < longest < _LONGEST_STEP:  # nothing to do; or nonsense, which Newton's method will notice
            return here + step
        small = _DIFFERENCE / longest
        rate = (self.coordinates(here + small * step) - self.coordinates(here - small * step)) / (2.0 * small)
        return self.unknowns(self.coordinates(here) + rate)


_LONGEST_STEP = 1e6
_DIFFERENCE = 1e-3  # of the unknowns; the error of the rate is its square, times the coordinates' third derivative


class _NoEquilibriumError(RuntimeError):
    pass


def follow_load(
    residual: Residual,
    tangent: Tangent,
    start: NDArray[np.float64],
    solve: LinearSolver,
    control: StepControl | None = None,
    accept: Accept | None = None,
    chart: Chart | None = None,
    earlier: Sequence[Equilibrium] = (),
) -> NDArray[np.float64]:
    """Return the unknowns at load parameter 1, following equilibria from ``start`` at 0.

    Each step starts from the cubic through the last four equilibria; Newton's method then converges quadratically. A
    step that does not converge is halved, an easy one is followed by one 1.5 times as long.

    Args:
        residual, tangent: forces out of balance and their derivative, of (unknowns, load parameter).
        accept: told every equilibrium before the next step. False: the problem is another one now (a node has touched
            something), find the equilibrium again.
        chart: see :class:`Chart`; by default the unknowns are their own coordinates.
        earlier: other equilibria, at loads below 0 or above 1, the last one nearest.

    Raises:
        LoadStepError: the smallest step found no equilibrium: a limit point, or an element turned inside out.
    """
    control = control or StepControl()
    load, step, unknowns = 0.0, control.first_step, start
    passed: list[Equilibrium] = [*earlier[1 - _EXTRAPOLATED :], (load, start)]
    while load < 1.0:
        wanted = load + step if load + step < 1.0 - _ROUNDING else 1.0  # ten steps of 0.1 end at 1, not just before
        guess = _extrapolated(passed, wanted, chart)
        try:
            found, iterations = _newton(residual, tangent, guess, wanted, solve, control, chart)
            for _ in range(control.most_revisions):
                if accept is None or accept(found, wanted):
                    break
                found, more = _newton(residual, tangent, found, wanted, solve, control, chart)
                iterations = max(iterations, more)
            else:
                raise _NoEquilibriumError("the contact does not settle")
        except _NoEquilibriumError as error:
            step *= 0.5
            if step < control.smallest_step:
                raise LoadStepError(f"no equilibrium beyond load parameter {load:.4f}: {error}", load) from error
            continue
        load, unknowns = wanted, found
        passed = [*passed[1 - _EXTRAPOLATED :], (load, unknowns)]
        if iterations <= 5:
            step = min(1.5 * step, control.largest_step)
    return unknowns


def _extrapolated(passed: Sequence[Equilibrium], wanted: float, chart: Chart | None) -> NDArray[np.float64]:
    """The polynomial through the last equilibria, in the chart if there is one, at the load ``wanted``."""
    if len(passed) < 2:
        return passed[-1][1]
    loads = [load for load, _ in passed]
    guess = np.zeros(())
    for load, unknowns in passed:
        weight = math.prod((wanted - other) / (load - other) for other in loads if other != load)
        guess = guess + weight * (chart.coordinates(unknowns) if chart else unknowns)
    return chart.unknowns(guess) if chart else guess


def _newton(
    residual: Residual,
    tangent: Tangent,
    guess: NDArray[np.float64],
    load: float,
    solve: LinearSolver,
    control: StepControl,
    chart: Chart | None,
) -> tuple[NDArray[np.float64], int]:
    unknowns = guess
    for iteration in range(control.most_iterations):
        with np.errstate(all="ignore"):
            force = residual(unknowns, load)
            if not np.all(np.isfinite(force)):
                raise _NoEquilibriumError("an element turned inside out")
            if np.abs(force).max() < control.residual_n:
                return unknowns, iteration
            matrix = tangent(unknowns, load)
            updated = isinstance(matrix, UpdatedMatrix)
            step = matrix.solve(solve, -force) if updated else solve(matrix, -force)
        if not np.all(np.isfinite(step)):
            raise _NoEquilibriumError("the tangent is singular")
        unknowns = chart.moved(unknowns, step) if chart else unknowns + step
    raise _NoEquilibriumError(f"{np.abs(force).max():.1e} N out of balance after {control.most_iterations} iterations")
