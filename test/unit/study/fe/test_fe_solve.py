import importlib.util
import pickle
import sys

import numpy as np
import pytest
from scipy.sparse import csr_matrix

from mbpam_ros.study.fe import solve
from mbpam_ros.study.fe.solve import Chart, LoadStepError, StepControl, UpdatedMatrix, follow_load, linear_solver

SUPERLU = linear_solver("superlu")


def follow(residual, tangent, start=0.0, control=None):
    def force(q, load):
        return np.array([residual(q[0], load)])

    def slope(q, load):
        return csr_matrix([[tangent(q[0], load)]])

    return follow_load(force, slope, np.array([start]), SUPERLU, control)[0]


def test_a_nonlinear_spring_is_followed_to_its_load():
    assert follow(lambda q, load: q + q**3 - 10.0 * load, lambda q, load: 1 + 3 * q**2) == pytest.approx(2.0, abs=1e-7)


def test_steps_that_add_up_to_the_load_but_for_rounding_end_at_it():
    loads = []

    def force(q, load):
        return np.array([q[0] + q[0] ** 3 - load])

    def accept(q, load):
        loads.append(load)
        return True

    tenths = StepControl(first_step=0.1, largest_step=0.1)
    follow_load(force, lambda q, load: csr_matrix([[1 + 3 * q[0] ** 2]]), np.zeros(1), SUPERLU, tenths, accept)
    assert loads[-1] == 1.0 and len(loads) == 10  # 0.1 added ten times is a little less


def test_a_limit_point_is_an_error_that_names_the_load_reached():
    with pytest.raises(LoadStepError) as caught:  # q - q^2 never exceeds 1/4
        follow(lambda q, load: q - q**2 - 0.5 * load, lambda q, load: 1 - 2 * q)
    assert caught.value.reached == pytest.approx(0.5, abs=1e-3)


def test_the_error_of_another_process_arrives_whole():
    error = pickle.loads(pickle.dumps(LoadStepError("stopped at 12 kPa", 12.0)))
    assert (str(error), error.reached) == ("stopped at 12 kPa", 12.0)


def test_what_is_not_a_number_ends_a_step_and_not_the_run():
    """A step of 0.25 would leave the domain of the logarithm; smaller ones do not."""
    with_guard = follow(
        lambda q, load: np.log(1.0 - q) + 5.0 * load,
        lambda q, load: -1.0 / (1.0 - q),
        control=StepControl(first_step=1.0, largest_step=1.0),
    )
    assert with_guard == pytest.approx(1.0 - np.exp(-5.0), abs=1e-7)


def test_without_pypardiso_scipys_solver_takes_over(monkeypatch):
    found = importlib.util.find_spec
    monkeypatch.setattr(solve.importlib.util, "find_spec", lambda name: None if name == "pypardiso" else found(name))
    monkeypatch.setitem(sys.modules, "pypardiso", None)  # an import would fail
    matrix = csr_matrix([[2.0, 1.0], [1.0, 3.0]])
    assert linear_solver()(matrix, np.array([3.0, 4.0])) == pytest.approx([1.0, 1.0])


def test_an_unknown_solver_is_refused():
    with pytest.raises(ValueError, match="pardiso, superlu"):
        linear_solver("magic")


def test_a_state_that_changes_the_problem_is_found_again():
    """A spring that is twice as stiff from the first time it is stretched by more than one half."""
    stiffness = [1.0]

    def accept(q, load):
        if q[0] > 0.5 and stiffness[0] == 1.0:
            stiffness[0] = 2.0
            return False
        return True

    found = follow_load(
        lambda q, load: stiffness[0] * q - load,
        lambda q, load: csr_matrix([[stiffness[0]]]),
        np.zeros(1),
        SUPERLU,
        accept=accept,
    )
    assert found == pytest.approx([0.5])


def test_a_problem_that_never_settles_is_an_error():
    with pytest.raises(LoadStepError, match="does not settle"):
        follow_load(
            lambda q, load: q - load, lambda q, load: csr_matrix([[1.0]]), np.zeros(1), SUPERLU, accept=lambda *_: False
        )


def test_a_turn_in_polar_coordinates_is_followed_in_one_step_and_to_the_same_place():
    """A point on a stiff radius is turned by a torsion spring: straight lines stretch the radius on the way."""
    stiff = 1e6

    def polar(q):
        return np.array([np.hypot(*q), np.arctan2(q[1], q[0])])

    def place(rho):
        return rho[0] * np.array([np.cos(rho[1]), np.sin(rho[1])])

    def residual(q, load):
        radius, angle = polar(q)
        across = np.array([-q[1], q[0]]) / radius
        return stiff * (radius - 1.0) * q / radius + (angle - 2.0 * load) * across / radius

    def tangent(q, load):
        columns = [(residual(q + d, load) - residual(q - d, load)) / 2e-6 for d in 1e-6 * np.eye(2)]
        return csr_matrix(np.array(columns).T)

    control = StepControl(first_step=1.0, smallest_step=0.6, most_iterations=4)
    start = np.array([1.0, 0.0])
    with pytest.raises(LoadStepError):
        follow_load(residual, tangent, start, SUPERLU, control)
    found = follow_load(residual, tangent, start, SUPERLU, control, chart=Chart(polar, place))
    assert found == pytest.approx([np.cos(2.0), np.sin(2.0)], abs=1e-6)


@pytest.mark.parametrize("name", ["superlu", "pardiso"])
def test_unsymmetric_tangents_are_solved(name):
    if name == "pardiso":
        pytest.importorskip("pypardiso")
    matrix = csr_matrix([[2.0, 1.0, 0.0], [-0.5, 3.0, 0.2], [0.0, 0.7, 1.0]])
    right = np.array([3.0, 4.0, -1.0])
    assert matrix @ linear_solver(name, symmetric=False)(matrix, right) == pytest.approx(right)


def test_a_solver_is_right_for_other_values_and_other_patterns_than_its_last():
    pytest.importorskip("pypardiso")
    solve, rng = linear_solver("pardiso"), np.random.default_rng(3)
    for size, columns in ((6, 1), (6, 1), (6, 2), (9, 3), (6, 1)):
        dense = rng.standard_normal((size, size))
        matrix = csr_matrix(dense + dense.T)
        right = rng.standard_normal((size, columns))
        assert matrix @ solve(matrix, right) == pytest.approx(right)
        assert matrix @ solve(matrix, right[:, 0]) == pytest.approx(right[:, 0])


def test_a_solver_is_right_for_other_values_at_the_same_indices_and_for_the_same_size_at_others():
    """The last matrix's indices tell where the upper triangle is only to a matrix that shares them."""
    pytest.importorskip("pypardiso")
    solve, rng = linear_solver("pardiso"), np.random.default_rng(4)
    dense = rng.standard_normal((8, 8)) * (rng.random((8, 8)) < 0.4)
    first, right = csr_matrix(dense + dense.T + 4.0 * np.eye(8)), rng.standard_normal(8)
    shares = csr_matrix(first.shape)
    shares.data, shares.indices, shares.indptr = first.data**3, first.indices, first.indptr
    other = csr_matrix(np.flip(first.toarray()))
    for matrix in (first, shares, other, shares):
        assert matrix @ solve(matrix, right) == pytest.approx(right)


def test_an_update_of_low_rank_is_solved_with_the_symmetric_matrix_alone():
    rng = np.random.default_rng(5)
    dense = rng.standard_normal((7, 7))
    symmetric = csr_matrix(dense + dense.T + 10.0 * np.eye(7))
    left, right, load = rng.standard_normal((7, 3)), rng.standard_normal((7, 3)), rng.standard_normal(7)
    found = UpdatedMatrix(symmetric, left, right).solve(SUPERLU, load)
    assert (symmetric.toarray() - left @ right.T) @ found == pytest.approx(load)


def test_a_follower_load_converges_as_newtons_method_does():
    """A rod of two links with torsion springs under a follower force: an unsymmetric tangent of low rank."""
    iterations = []

    def residual(q, load):
        iterations.append(load)
        return np.array([2.0 * q[0] - q[1] - 1.5 * load * np.sin(q[1] - q[0]), q[1] - q[0] - load])

    def tangent(q, load):
        bend = 1.5 * load * np.cos(q[1] - q[0])
        symmetric = csr_matrix([[2.0, -1.0], [-1.0, 1.0]])
        return UpdatedMatrix(symmetric, np.array([[1.0], [0.0]]), np.array([[-bend], [bend]]))

    found = follow_load(residual, tangent, np.zeros(2), SUPERLU, StepControl(first_step=1.0, residual_n=1e-10))
    assert found[1] - found[0] == pytest.approx(1.0)
    assert len(iterations) <= 6


def test_guesses_follow_a_cubic_way_exactly_in_the_charts_coordinates():
    """Four equilibria tell where the fifth is, whose coordinate is a cubic of the load."""
    first_guesses = {}

    def residual(q, load):
        first_guesses.setdefault(load, abs(q[0] - load))
        return q - load

    chart = Chart(lambda q: q**3 + 3.0 * q**2, lambda rho: np.roots([1.0, 3.0, 0.0, -rho[0]]).real.max(keepdims=True))
    fifths = StepControl(residual_n=1e-12, first_step=0.2, largest_step=0.2)
    follow_load(residual, lambda q, load: csr_matrix([[1.0]]), np.zeros(1), SUPERLU, fifths, chart=chart)
    assert max(off for load, off in first_guesses.items() if load > 0.7) < 1e-9
    assert first_guesses[0.2] == pytest.approx(0.2)
