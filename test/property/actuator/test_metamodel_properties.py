"""Units and offsets of a, b and the response change no prediction of any metamodel."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mbpam_ros.actuator.design import PAPER_DOMAIN, DesignDomain
from mbpam_ros.actuator.metamodel import METAMODELS, TRAINING_TABLE, read_samples

DESIGN, THETA, FORCE = read_samples(TRAINING_TABLE)
QUERY = np.random.default_rng(8).uniform([1.5, 1.0], [3.5, 3.0], size=(30, 2))
FACTORS = st.floats(-12.0, 12.0).map(lambda exponent: 10.0**exponent)
SIGNED = st.tuples(FACTORS, st.sampled_from([-1.0, 1.0])).map(np.prod)
OFFSETS = st.floats(-1e3, 1e3)
"""Of the scaled quantity over its range: a thousand ranges off zero leaves 13 of 16 digits."""


@pytest.mark.parametrize("name", METAMODELS)
@settings(max_examples=12, deadline=None)
@given(st.tuples(FACTORS, FACTORS), st.tuples(OFFSETS, OFFSETS), SIGNED, OFFSETS, st.booleans())
def test_predictions_follow_units_and_offsets(name, factor, offset, response_factor, response_offset, of_force):
    def moved(design):
        return (design + offset) * factor

    response = FORCE if of_force else THETA
    spread = np.ptp(response)
    low, high = moved(PAPER_DOMAIN.bounds_mm)
    domain = DesignDomain((low[0], high[0]), (low[1], high[1]))
    plain = METAMODELS[name]().fit(DESIGN, response)
    changed = METAMODELS[name](domain=domain).fit(
        moved(DESIGN), response_factor * (response + response_offset * spread)
    )
    expected = plain.predict(QUERY)
    found = changed.predict(np.clip(moved(QUERY), low, high)) / response_factor - response_offset * spread
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=TOLERANCE[name] * spread)
    if plain.deviation(QUERY) is not None:
        deviation = changed.deviation(np.clip(moved(QUERY), low, high)) / abs(response_factor)
        np.testing.assert_allclose(deviation, plain.deviation(QUERY), rtol=1e-3, atol=TOLERANCE[name] * spread)


TOLERANCE = {"prs": 1e-8, "rbf": 1e-8, "krg": 1e-4, "rbf_gaussian": 1e-4, "krg_nugget": 1e-4}
"""Of the response's range. Searches for length scales and widths end where the slope is small, not on one digit."""
