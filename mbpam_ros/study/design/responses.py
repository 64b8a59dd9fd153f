"""The two responses that are optimised, over a domain: a metamodel fitted to samples, or the paper's printed one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.actuator.design import PAPER_DOMAIN, DesignDomain
from mbpam_ros.actuator.metamodel import METAMODELS, Metamodel, metamodel_name
from mbpam_ros.actuator.tables import read_table
from mbpam_ros.study.design.pareto import Objectives
from mbpam_ros.study.design.samples import Samples

PUBLISHED = "published"
"""Name of the paper's Eqs. 9 and 10 with the coefficients it prints."""

_PUBLISHED_TABLE = "response_surface.csv"


@dataclass(frozen=True)
class Responses:
    """Greatest bend [deg] and blocked force [N] over a domain.

    ``objectives`` maps designs (a, b) [mm], shape (n, 2), to rows (theta_max, f_max), shape (n, 2).
    """

    objectives: Objectives
    domain: DesignDomain


def fitted_responses(name: str, samples: Samples) -> Responses:
    """Return the metamodel ``name`` of :data:`METAMODELS`, fitted to ``samples``, over the box that they fill.

    Raises:
        DesignDomainError, MetamodelError: the samples do not determine it.
    """
    domain = samples.domain()
    models = [
        METAMODELS[metamodel_name(name)](domain=domain).fit(samples.design_mm, samples.responses[key])
        for key in samples.responses
    ]
    return Responses(_Fitted(tuple(models)), domain)


def published_coefficients() -> dict[str, NDArray[np.float64]]:
    """Return the coefficients of Eqs. 9 (``theta_max`` [deg]) and 10 (``f_max`` [N]), shape (8,) each.

    They belong to 1, a, b, a^2, b^2, a b, a^3, b^3, with a and b in millimetres.

    Raises:
        ConfigError: ``response_surface.csv`` is missing or unreadable.
    """
    theta, force = read_table(_PUBLISHED_TABLE, "theta_max_deg", "f_max_n")
    return {"theta_max": theta, "f_max": force}


def published_responses() -> Responses:
    """Return the paper's Eqs. 9 and 10 as printed, over the domain of its Eq. 11.

    Their coefficients have four decimals, and those of the force differ from a refit of Table 1 by up to 0.1 %. The
    paper's two improvements are those of these equations.

    Raises:
        ConfigError: ``response_surface.csv`` is missing or unreadable.
    """
    power_a, power_b = read_table(_PUBLISHED_TABLE, "power_of_a", "power_of_b")
    return Responses(_Printed(power_a, power_b, np.column_stack(list(published_coefficients().values()))), PAPER_DOMAIN)


@dataclass(frozen=True)
class _Fitted:
    """A metamodel a response; no closure, so that other processes can be sent it."""

    models: tuple[Metamodel, ...]

    def __call__(self, design_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.column_stack([model.predict(design_mm) for model in self.models])


@dataclass(frozen=True, eq=False)
class _Printed:
    """Polynomials a response; no closure, likewise."""

    power_a: NDArray[np.float64]
    power_b: NDArray[np.float64]
    weights: NDArray[np.float64]

    def __call__(self, design_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        PAPER_DOMAIN.require_inside(design_mm)
        a, b = design_mm.T
        return (a[:, None] ** self.power_a * b[:, None] ** self.power_b) @ self.weights
