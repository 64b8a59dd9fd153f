import numpy as np
import pytest

from mbpam_ros.study.fe.material import Silicone, YeohMaterial

RNG = np.random.default_rng(3)
DEFORMATION = np.eye(3)[..., None] + 0.15 * RNG.standard_normal((3, 3, 4))
MATERIAL = YeohMaterial(Silicone(), with_volume=True)


def central(function, direction, step=1e-6):
    return (function(DEFORMATION + step * direction) - function(DEFORMATION - step * direction)) / (2.0 * step)


def test_stress_is_the_slope_of_the_energy():
    direction = RNG.standard_normal(DEFORMATION.shape)
    stress = MATERIAL.gradient([DEFORMATION, None])[0]
    assert np.sum(stress * direction, axis=(0, 1)) == pytest.approx(central(MATERIAL.energy, direction), rel=1e-6)


def test_elasticity_is_the_slope_of_the_stress_and_symmetric():
    direction = RNG.standard_normal(DEFORMATION.shape)
    elasticity = MATERIAL.hessian([DEFORMATION, None])[0]
    slope = central(lambda f: MATERIAL.gradient([f, None])[0], direction)
    assert np.einsum("ijklp,klp->ijp", elasticity, direction) == pytest.approx(slope, rel=1e-6, abs=1e-6)
    assert elasticity == pytest.approx(elasticity.transpose(2, 3, 0, 1, 4), rel=1e-12, abs=1e-12)


def test_uniaxial_tension_without_change_of_volume_gives_yeohs_stress():
    stretch = 1.7
    f = np.diag([stretch, stretch**-0.5, stretch**-0.5])[..., None]
    stress = YeohMaterial(Silicone(), with_volume=False).gradient([f, None])[0][..., 0]
    tension = stress[0, 0] - stress[1, 1] * stretch**-1.5  # the pressure that frees the sides taken out
    excess = stretch**2 + 2.0 / stretch - 3.0
    slope = 0.1154 - 2 * 0.0091 * excess + 3 * 0.0055 * excess**2
    assert tension == pytest.approx(2.0 * slope * (stretch - stretch**-2), rel=1e-12)


def test_a_silicone_without_stiffness_is_refused():
    with pytest.raises(ValueError):
        Silicone(bulk_mpa=0.0)


def test_a_cube_that_is_pulled_has_yeohs_true_stress_on_elements_of_every_kind():
    """Its stretch in closed form; the sides are free, so the pressure is what leaves them without stress."""
    pytest.importorskip("felupe")
    from mbpam_ros.study.fe.solid_body import SolidBody

    silicone = Silicone()
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]], float)
    edges = [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)]
    stretch = 1.7
    excess = stretch**2 + 2.0 / stretch - 3.0
    slope = silicone.c10_mpa + 2.0 * silicone.c20_mpa * excess + 3.0 * silicone.c30_mpa * excess**2
    pressure = 2.0 * slope * (stretch**2 - 1.0 / stretch) / 3.0  # mean of the stresses, with K (J - 1) of that size
    jacobian = 1.0 + pressure / silicone.bulk_mpa
    for points in (corners, np.concatenate([corners, [0.5 * (corners[i] + corners[j]) for i, j in edges]])):
        body = SolidBody(points, np.arange(len(points))[None], silicone)
        pulled = points * [stretch, *[(jacobian / stretch) ** 0.5] * 2]
        stretches, stresses, volumes = body.largest_principal(pulled)
        assert stretches == pytest.approx(stretch) and volumes.sum() == pytest.approx(1.0)
        assert stresses == pytest.approx(3.0 * pressure, rel=0.01)
