import math

import numpy as np
import pytest

from mbpam_ros.actuator.calibration import calibrate
from mbpam_ros.actuator.tip_force import TipForce
from mbpam_ros.gripper import load_gripper

GRIPPER = load_gripper()
FORCE = calibrate(GRIPPER.design, GRIPPER.geometry).tip_force
RNG = np.random.default_rng(3)
MOMENTS = RNG.uniform(-0.04, 0.04, (50, 2))


def along(azimuth_deg, size):
    azimuth = math.radians(azimuth_deg)
    return np.asarray(size)[..., None] * [math.cos(azimuth), math.sin(azimuth)]


@pytest.mark.parametrize("azimuth_deg", range(0, 360, 45))
def test_the_eight_directions_have_the_tabulated_force(azimuth_deg):
    pattern = "psc" if azimuth_deg % 90 else "pdc"
    moment, force = getattr(FORCE, f"{pattern}_moment_n_m"), getattr(FORCE, f"{pattern}_force_n")
    np.testing.assert_allclose(FORCE.at(along(azimuth_deg, moment)), force, rtol=1e-9)


def test_a_turned_or_mirrored_moment_has_the_same_force():
    quarter = np.stack([-MOMENTS[:, 1], MOMENTS[:, 0]], axis=1)
    for image in (quarter, MOMENTS * [1.0, -1.0], MOMENTS[:, ::-1]):
        np.testing.assert_allclose(FORCE.at(image), FORCE.at(MOMENTS), rtol=1e-12)


def test_between_two_directions_the_force_lies_between_theirs():
    for size in (0.005, 0.02, 0.035):
        ends = FORCE.at([along(0.0, size), along(45.0, size)])
        assert (FORCE.at([along(azimuth, size) for azimuth in range(1, 45)]) >= ends.min() - 1e-12).all()
        assert (FORCE.at([along(azimuth, size) for azimuth in range(1, 45)]) <= ends.max() + 1e-12).all()


def test_no_moment_is_no_force_and_an_unknown_one_an_unknown_force():
    np.testing.assert_array_equal(FORCE.at([[0.0, 0.0], [1e-320, 0.0]]) < 1e-300, True)
    assert math.isnan(FORCE.at([math.nan, 0.0]))


def test_a_table_that_does_not_rise_is_refused():
    rising, one = np.array([1.0, 2.0]), np.array([1.0, 1.0])
    with pytest.raises(ValueError, match="psc: one force for each of rising"):
        TipForce(one, rising, rising, rising)
    with pytest.raises(ValueError, match="pdc: one force for each of rising"):
        TipForce(rising, rising, rising, np.array([1.0]))
