"""Particle swarm and NSGA-II against fronts that are known."""

import sys

import numpy as np
import pytest

from mbpam_ros.actuator.design import PAPER_DOMAIN, DesignDomain
from mbpam_ros.actuator.metamodel import METAMODELS
from mbpam_ros.study.design.evaluations import Evaluations, OptimisationError
from mbpam_ros.study.design.mopso import SwarmSettings, crowding_distance, mopso
from mbpam_ros.study.design.nsga2 import nsga2
from mbpam_ros.study.design.pareto import grid_front, hypervolume_ratio
from mbpam_ros.study.design.responses import fitted_responses, published_responses
from mbpam_ros.study.design.samples import Samples

UNIT = DesignDomain((0.0, 1.0), (0.0, 1.0))


def hollow(design):
    """Fonseca and Fleming's problem on [-1, 1]^2: designs a = b, and a hollow front."""
    x = 2.0 * design - 1.0
    return np.column_stack([-1.0 + np.exp(-((x - s / np.sqrt(2.0)) ** 2).sum(axis=1)) for s in (1.0, -1.0)])


@pytest.mark.parametrize("optimiser", [mopso, nsga2])
def test_the_papers_front_is_covered_with_every_seed(optimiser):
    if optimiser is nsga2:
        pytest.importorskip("pymoo")
    responses = published_responses()
    truth = grid_front(responses.objectives, responses.domain, 401)
    for seed in range(3) if optimiser is mopso else range(1):
        evaluations = Evaluations(responses.objectives, responses.domain)
        optimiser(evaluations, seed)
        assert evaluations.count == 10_100
        assert hypervolume_ratio(evaluations.front(), truth) > 0.997


@pytest.mark.parametrize("name", ["rbf", "krg"])
def test_the_front_of_an_interpolating_metamodel_is_covered(name):
    responses = fitted_responses(name, Samples.of_the_paper("doe_training.csv"))
    truth = grid_front(responses.objectives, responses.domain, 201)
    evaluations = Evaluations(responses.objectives, responses.domain)
    mopso(evaluations, 0)
    assert hypervolume_ratio(evaluations.front(), truth) > 0.995


@pytest.mark.parametrize("optimiser", [mopso, nsga2])
def test_a_hollow_front_is_found_to_its_ends(optimiser):
    if optimiser is nsga2:
        pytest.importorskip("pymoo")
    evaluations = Evaluations(hollow, UNIT)
    optimiser(evaluations, 1)
    front = evaluations.front()
    ends = np.array([0.5, 0.5]) + np.array([[-1.0], [1.0]]) / (2.0 * np.sqrt(2.0))
    np.testing.assert_allclose(front.design_mm[[0, -1]], ends, atol=0.03)
    assert hypervolume_ratio(front, grid_front(hollow, UNIT, 401)) > 0.99


@pytest.mark.parametrize("optimiser", [mopso, nsga2])
def test_equal_seeds_give_equal_bits_and_others_do_not(optimiser):
    if optimiser is nsga2:
        pytest.importorskip("pymoo")
    short = {"settings": SwarmSettings(iterations=5)} if optimiser is mopso else {"generations": 5}
    fronts = []
    for seed in (3, 3, 4):
        evaluations = Evaluations(hollow, UNIT)
        optimiser(evaluations, seed, **short)
        fronts.append(evaluations.front().design_mm.tobytes())
    assert fronts[0] == fronts[1] != fronts[2]


def test_the_swarm_is_the_papers():
    settings = SwarmSettings()
    assert (settings.iterations, settings.particles, settings.inertia) == (100, 100, 0.8)
    assert (settings.global_increment, settings.particle_increment, settings.max_velocity) == (0.5, 0.9, 0.1)


def test_no_particle_leaves_the_domain_or_flies_faster_than_it_may():
    seen = []

    def recorded(design):
        PAPER_DOMAIN.require_inside(design)
        seen.append(design)
        return np.column_stack([design[:, 0], -design[:, 1]])

    mopso(Evaluations(recorded, PAPER_DOMAIN), 0, SwarmSettings(iterations=20, particles=30))
    steps = np.abs(np.diff(np.array(seen), axis=0))
    assert steps.max() == pytest.approx(0.1 * 2.0)


def test_the_swarm_beats_chance_at_equal_cost():
    responses = published_responses()
    truth = grid_front(responses.objectives, responses.domain, 201)
    swarm, chance = (Evaluations(responses.objectives, responses.domain) for _ in range(2))
    mopso(swarm, 0, SwarmSettings(iterations=30))
    chance(np.random.default_rng(0).uniform(size=(swarm.count, 2)))
    assert 1.0 - hypervolume_ratio(swarm.front(), truth) < 0.5 * (1.0 - hypervolume_ratio(chance.front(), truth))


def test_crowding_is_the_neighbours_distance_and_infinite_at_the_ends():
    values = np.array([[0.0, 4.0], [1.0, 3.0], [4.0, 0.0], [3.0, 2.0]])
    np.testing.assert_allclose(crowding_distance(values), [np.inf, 3 / 4 + 2 / 4, np.inf, 3 / 4 + 3 / 4])


def test_five_failed_evaluations_may_be_and_a_sixth_stops_the_run():
    def fails(count):
        def objectives(design):
            values = np.column_stack([design[:, 0], 1.0 - design[:, 0]])
            values[:count] = np.nan
            return values

        return objectives

    evaluations = Evaluations(fails(5), UNIT)
    evaluations(np.full((9, 2), 0.5))
    assert np.isfinite(evaluations.front().values).all()
    with pytest.raises(OptimisationError, match="6 evaluations failed, 5 may"):
        Evaluations(fails(6), UNIT)(np.full((9, 2), 0.5))


def test_a_swarm_flies_on_after_a_failed_evaluation():
    calls = []

    def objectives(design):
        values = hollow(design)
        if not calls:
            values[3] = np.nan
        calls.append(len(design))
        return values

    evaluations = Evaluations(objectives, UNIT)
    mopso(evaluations, 0, SwarmSettings(iterations=30))
    assert len(calls) == 31
    assert hypervolume_ratio(evaluations.front(), grid_front(hollow, UNIT, 201)) > 0.9


@pytest.mark.parametrize("wrong", [{"particles": 0}, {"iterations": 0}, {"archive_size": 1}])
def test_an_empty_swarm_is_refused(wrong):
    with pytest.raises(ValueError, match="at least 1 iteration"):
        SwarmSettings(**wrong)
    with pytest.raises(ValueError, match="velocity"):
        SwarmSettings(max_velocity=0.0)


def test_without_pymoo_nsga2_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "pymoo.optimize", None)
    with pytest.raises(OptimisationError, match=r"mbpam_ros\[study\]"):
        nsga2(Evaluations(hollow, UNIT), 0)


def test_every_metamodel_can_be_optimised():
    samples = Samples.of_the_paper("doe_training.csv")
    for name in METAMODELS:
        responses = fitted_responses(name, samples)
        assert responses.objectives(np.array([[2.0, 2.0], [2.5, 2.0]])).shape == (2, 2)
