"""Samples that cannot carry a metamodel are refused by every metamodel, and the message names the cause."""

import re

import numpy as np
import pytest

from mbpam_ros.actuator.design import PAPER_DOMAIN, SAME_DESIGN_SHARE, DesignDomain
from mbpam_ros.actuator.metamodel import METAMODELS, TRAINING_TABLE, VALIDATION_TABLE, MetamodelError, read_samples
from mbpam_ros.actuator.sample_check import QUADRATIC, monomials, require_determining
from mbpam_ros.study.design.latin_hypercube import optimal_latin_hypercube

EVERY = pytest.mark.parametrize("name", METAMODELS)
ALONG = np.linspace(-1.0, 1.0, 21)
ALTERNATING = np.where(np.arange(21) % 2, 1.0, -1.0)
JITTER = np.random.default_rng(4).uniform(-1.0, 1.0, size=21)


def refusal(name, scaled):
    """What metamodel ``name`` says of designs in [-1, 1]^2, moved to 40 ... 60 mm and 7 ... 8 mm."""
    design = scaled * [10.0, 0.5] + [50.0, 7.5]
    response = np.sin(design[:, 0]) + design[:, 1] ** 2
    with pytest.raises(MetamodelError) as refused:
        METAMODELS[name](domain=DesignDomain((39.0, 61.0), (6.9, 8.1))).fit(design, response)
    return str(refused.value)


@EVERY
@pytest.mark.parametrize("jitter", [0.0, 1e-9, 1e-4, 1e-2, 0.05])
def test_designs_on_a_line_or_nearly_are_refused_with_the_direction_that_nothing_tells(name, jitter):
    said = refusal(name, np.column_stack([ALONG, -ALONG + jitter * JITTER]))
    assert "lie on a line along" in said and "condition number" in said
    along, across = (
        np.array(re.search(words + r" \((\S+), (\S+)\)", said).groups(), dtype=float)
        for words in (r"along \(a, b\) =", "nothing is known in direction")
    )
    # In the scaled box (1, -1) and, perpendicular to it, (1, 1); a unit of it is 10 mm of a and 0.5 mm of b.
    np.testing.assert_allclose([along, across], [[1.0, -0.05], [1.0, 0.05]], rtol=0.05)


@EVERY
@pytest.mark.parametrize("jitter", [0.0, 1e-4])
@pytest.mark.parametrize(
    ("across", "named"),
    [
        (2.0 * ALONG**2 - 1.0, "a^2"),
        (ALTERNATING * np.sqrt(1.0 - ALONG**2), "b^2"),
        (ALTERNATING * ALONG, "b^2"),
    ],
    ids=["parabola", "circle", "crossed lines"],
)
def test_designs_on_a_conic_or_nearly_are_refused_with_its_equation(name, across, named, jitter):
    said = refusal(name, np.column_stack([ALONG, across + jitter * JITTER]))
    assert "lie on one curve" in said and named in said.split("nearly:")[1].split("= 0")[0]


@EVERY
def test_two_values_of_a_variable_are_too_few_for_any_curvature(name):
    assert "b has only 2 different values, a quadratic needs at least 3" in refusal(
        name, np.column_stack([ALONG, ALTERNATING])
    )


def test_three_values_carry_every_metamodel_but_the_cubic():
    levels = np.array([-1.0, 0.0, 1.0])[np.arange(21) % 3]
    scaled = np.column_stack([ALONG, levels])
    assert "b has only 3 different values, a cubic needs at least 4" in refusal("prs", scaled)
    for name in set(METAMODELS) - {"prs"}:
        model = METAMODELS[name](domain=DesignDomain((-1.0, 1.0), (-1.0, 1.0)))
        assert np.isfinite(model.fit(scaled, np.sin(ALONG) + levels**2).predict([[0.1, 0.5]])).all()


@EVERY
@pytest.mark.parametrize("column", [0, 1])
@pytest.mark.parametrize("wobble", [0.0, 1e-13])
def test_a_variable_that_does_not_vary_is_named(name, column, wobble):
    scaled = np.random.default_rng(1).uniform(-1.0, 1.0, size=(21, 2))
    scaled[:, column] = 0.25 + wobble * JITTER
    assert f"{'ab'[column]} is {[52.5, 7.625][column]:g} mm in all samples" in refusal(name, scaled)


@EVERY
@pytest.mark.parametrize("apart", [0.0, 1e-12, 1e-9, 0.9 * SAME_DESIGN_SHARE])
def test_the_same_design_twice_is_refused_however_little_the_two_differ(name, apart):
    design, theta, _ = read_samples(TRAINING_TABLE)
    again = design[3] + apart * np.array([2.0, -2.0])  # of a range of 2 mm
    with pytest.raises(MetamodelError, match=r"samples 4 and 22 have the same design a = 2\.5, b = 2\.2 mm.*keep one"):
        METAMODELS[name]().fit(np.vstack([design, again]), np.append(theta, theta[3] + 2.0))


def test_designs_further_apart_than_the_tolerance_are_two():
    design, _, _ = read_samples(TRAINING_TABLE)
    require_determining(np.vstack([design, design[3] + [2.2 * SAME_DESIGN_SHARE, 0.0]]), PAPER_DOMAIN, 6)


@EVERY
def test_too_few_samples_are_refused_with_their_number(name):
    scaled = np.random.default_rng(1).uniform(-1.0, 1.0, size=(5, 2))
    assert "expected at least" in refusal(name, scaled) and "found 5" in refusal(name, scaled)


@pytest.mark.parametrize("table", [TRAINING_TABLE, VALIDATION_TABLE])
def test_the_papers_samples_pass(table):
    require_determining(read_samples(table)[0], PAPER_DOMAIN, 6)


@pytest.mark.slow
@pytest.mark.parametrize("count", [9, 12, 21, 60])
def test_what_sample_design_gives_passes(count):
    for seed in range(5):
        unit = optimal_latin_hypercube(count, 2, seed, restarts=1)
        require_determining(unit, DesignDomain((0.0, 1.0), (0.0, 1.0)), 6)


def test_the_check_sees_neither_units_nor_offsets():
    line = np.column_stack([ALONG, ALONG + 0.01 * JITTER])
    good = optimal_latin_hypercube(12, 2, 0, restarts=1)
    for factor, offset in ((1e9, 0.0), (1e-6, 1000.0), (1.0, -1e6)):
        moved = good * [factor, 1.0] + [offset, 0.0]
        require_determining(moved, DesignDomain.around(moved), 6)
        moved = line * [factor, 1.0] + [offset, 0.0]
        with pytest.raises(MetamodelError, match="on a line"):
            require_determining(moved, DesignDomain.around(moved), 6)


def test_the_named_curve_passes_through_the_designs():
    scaled = np.column_stack([ALONG, 2.0 * ALONG**2 - 1.0])
    with pytest.raises(MetamodelError, match=r"\+1\.00 a\^2|1\.00 a\^2") as refused:
        require_determining(scaled, DesignDomain((-1.0, 1.0), (-1.0, 1.0)), 6)
    assert "0.50 b" in str(refused.value)
    np.testing.assert_allclose(monomials(scaled, QUADRATIC) @ [-0.5, 0.0, -0.5, 1.0, 0.0, 0.0], 0.0, atol=1e-15)
