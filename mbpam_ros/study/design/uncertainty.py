"""How far metamodels may be off, over the whole domain: kriging's own deviation, and what leaving samples out shows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mbpam_ros.actuator.metamodel import Kriging
from mbpam_ros.study.design.accuracy import Coverage
from mbpam_ros.study.design.samples import Samples


@dataclass(frozen=True)
class UncertaintyMap:
    """Uncertainty of each response over the domain.

    Args:
        a_mm, b_mm: grid lines, shape (m,) each [mm].
        sigma: standard deviation of a new sample, by response, shape (m, m), rows along b; its unit is the response's.
        left_out_error: prediction minus response at each sample when it is left out, by response, shape (n,).
        coverage: of these errors by the deviations that kriging states there.
    """

    a_mm: NDArray[np.float64]
    b_mm: NDArray[np.float64]
    sigma: dict[str, NDArray[np.float64]]
    left_out_error: dict[str, NDArray[np.float64]]
    coverage: dict[str, Coverage]


def uncertain_kriging(samples: Samples, trend: str = "constant", correlation: str = "gaussian") -> dict[str, Kriging]:
    """Return kriging with an estimated nugget over the samples' box, fitted to each response.

    Of all metamodels here its deviation is nearest to its errors; how near, :func:`left_out` tells.

    Raises:
        DesignDomainError: the samples do not span a range in both variables.
        MetamodelError: the samples do not determine a kriging metamodel.
    """
    domain = samples.domain()
    return {
        key: Kriging(trend, correlation, nugget=None, domain=domain).fit(samples.design_mm, response)
        for key, response in samples.responses.items()
    }


def kriging_sigma(kriging: dict[str, Kriging], design_mm: ArrayLike) -> dict[str, NDArray[np.float64]]:
    """Return the standard deviation of a new sample at ``design_mm``, shape (n, 2), by response, shape (n,).

    Raises:
        DesignDomainError: a design lies outside the domain; the message names the nearest one inside.
    """
    return {key: model.deviation(design_mm) for key, model in kriging.items()}


def left_out(
    samples: Samples, kriging: dict[str, Kriging]
) -> tuple[dict[str, NDArray[np.float64]], dict[str, Coverage]]:
    """Return, by response, the errors at samples left out in turn, shape (n,), and their coverage.

    Raises:
        MetamodelError: a sample cannot be spared.
    """
    errors, coverage = {}, {}
    for key, model in kriging.items():
        without = model.leave_one_out()
        errors[key] = without.predicted - samples.responses[key]
        if without.sigma is not None:
            coverage[key] = Coverage.of(errors[key], without.sigma, f"left out in turn, {without.how}")
    return errors, coverage


def uncertainty_map(samples: Samples, kriging: dict[str, Kriging], points: int = 61) -> UncertaintyMap:
    """Return kriging's deviation on a grid of ``points`` by ``points``, and its errors at samples that are left out.

    Raises:
        MetamodelError: a sample cannot be spared.
    """
    domain = samples.domain()
    a, b = (np.linspace(low, high, points) for low, high in (domain.a_range_mm, domain.b_range_mm))
    design = np.column_stack([axis.ravel() for axis in np.meshgrid(a, b)])
    sigma = {key: values.reshape(points, points) for key, values in kriging_sigma(kriging, design).items()}
    return UncertaintyMap(a, b, sigma, *left_out(samples, kriging))
