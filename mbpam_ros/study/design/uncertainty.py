"""How far metamodels may be off, over the whole domain: kriging's own deviation, and what leaving samples out shows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mbpam_ros.actuator.metamodel import Kriging
from mbpam_ros.study.design.accuracy import leave_one_out
from mbpam_ros.study.design.samples import Samples


@dataclass(frozen=True)
class UncertaintyMap:
    """Uncertainty of each response over the domain.

    Args:
        a_mm, b_mm: grid lines, shape (m,) each [mm].
        sigma: standard deviation of a new sample, by response, shape (m, m), rows along b; its unit is the response's.
        left_out_error: prediction minus response at each sample when it is left out, by response, shape (n,).
    """

    a_mm: NDArray[np.float64]
    b_mm: NDArray[np.float64]
    sigma: dict[str, NDArray[np.float64]]
    left_out_error: dict[str, NDArray[np.float64]]


def uncertain_kriging(
    samples: Samples, trend: str = "constant", correlation: str = "gaussian"
) -> Callable[[], Kriging]:
    """Return a maker of kriging metamodels over the samples' box whose deviation can be trusted (estimated nugget).

    Raises:
        DesignDomainError: the samples do not span a range in both variables.
    """
    domain = samples.domain()
    return lambda: Kriging(trend, correlation, nugget=None, domain=domain)


def kriging_sigma(
    samples: Samples, design_mm: ArrayLike, make: Callable[[], Kriging]
) -> dict[str, NDArray[np.float64]]:
    """Return the standard deviation of a new sample at ``design_mm``, shape (n, 2), by response, shape (n,).

    Raises:
        DesignDomainError: a design lies outside the domain; the message names the nearest one inside.
        MetamodelError: the samples do not determine a kriging metamodel.
    """
    return {
        key: np.sqrt(make().fit(samples.design_mm, response).predict_variance(design_mm))
        for key, response in samples.responses.items()
    }


def uncertainty_map(samples: Samples, make: Callable[[], Kriging], points: int = 61) -> UncertaintyMap:
    """Return kriging's deviation on a grid of ``points`` by ``points``, and its errors at samples that are left out.

    Raises:
        DesignDomainError, MetamodelError: the samples do not determine a kriging metamodel.
    """
    domain = samples.domain()
    a, b = (np.linspace(low, high, points) for low, high in (domain.a_range_mm, domain.b_range_mm))
    design = np.column_stack([axis.ravel() for axis in np.meshgrid(a, b)])
    sigma = kriging_sigma(samples, design, make)
    errors = {
        key: leave_one_out(make, samples.design_mm, response) - response for key, response in samples.responses.items()
    }
    return UncertaintyMap(a, b, {key: values.reshape(points, points) for key, values in sigma.items()}, errors)
