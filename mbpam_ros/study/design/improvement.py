"""What a front offers over a reference design: more force at its angle, more angle at its force."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mbpam_ros.study.design.pareto import Front
from mbpam_ros.study.design.responses import Responses
from mbpam_ros.study.design.samples import Samples


@dataclass(frozen=True)
class Reference:
    """A design with its angle and force, and where these come from: ``samples`` or ``metamodel``."""

    a_mm: float
    b_mm: float
    theta_deg: float
    f_n: float
    source: str


@dataclass(frozen=True)
class Gains:
    """What a front offers over a reference [%]; None where the front has no such angle or force."""

    gain_force_at_equal_angle_pct: float | None
    gain_angle_at_equal_force_pct: float | None


def reference_design(a_mm: float, b_mm: float, tables: Sequence[Samples], responses: Responses) -> Reference:
    """Return the design (a, b) with the values that the samples have for it; else with the metamodel's.

    Raises:
        DesignDomainError: the design is not among the samples and lies outside the metamodel's domain.
    """
    for table in tables:
        found = table.at(a_mm, b_mm, responses.domain)
        if found is not None:
            return Reference(a_mm, b_mm, *found, source="samples")
    theta, force = responses.objectives(np.array([[a_mm, b_mm]]))[0]
    return Reference(a_mm, b_mm, float(theta), float(force), source="metamodel")


def gains(front: Front, reference: Reference) -> Gains:
    """Return the front's force at the reference's angle and its angle at the reference's force, against these."""
    force, theta = front.second_at_first(reference.theta_deg), front.first_at_second(reference.f_n)
    return Gains(
        None if force is None else 100.0 * (force / reference.f_n - 1.0),
        None if theta is None else 100.0 * (theta / reference.theta_deg - 1.0),
    )
