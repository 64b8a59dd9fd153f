"""What was found out about a drawn muscle, in words."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from mbpam_ros.actuator.built_muscle import BuiltMuscle
from mbpam_ros.study.muscle.build import DRAWN


@dataclass(frozen=True)
class Findings:
    """Results of a run of ``mbpam muscle build``.

    Args:
        rows: of the finite elements of drawing and samples.
        failures: what has no equilibrium, and why.
        front: of :func:`~mbpam_ros.study.muscle.build.front_of`, with ``finite_elements`` and ``paper`` of
            :mod:`~mbpam_ros.study.muscle.front_check`; None if none was asked for.
        ranks: of :func:`~mbpam_ros.study.muscle.build.monotony`.
        alone: of :func:`~mbpam_ros.study.muscle.one_at_a_time.one_at_a_time`; None likewise.
        largest_stretch: that the silicone bears; None if it is not known.
    """

    rows: Sequence[dict[str, Any]]
    failures: dict[str, str]
    front: dict[str, Any] | None
    ranks: dict[str, dict[str, float]]
    alone: dict[str, Any] | None
    largest_stretch: float | None

    @property
    def wall_text(self) -> str:
        """The drawing's wall against what the silicone bears."""
        drawn = max((row for row in self.rows if row["name"].startswith(DRAWN)), key=lambda row: row["stretch_max"])
        said = (
            f"its silicone is stretched to {drawn['stretch_max']:.2f} at 100 kPa at most, a hundredth of it beyond "
            f"{drawn['stretch_99']:.2f} and {drawn['stress_99_mpa']:.2f} MPa"
        )
        if self.largest_stretch is None:
            return f"{said}; at what stretch it tears is not known"
        borne = f"specimens of it bore {self.largest_stretch:.2f}"
        if drawn["stretch_max"] > self.largest_stretch:
            return f"{said}: it may BURST, {borne}"
        return f"{said}; {borne}"

    def lines(self, built: BuiltMuscle) -> Iterator[str]:
        """Yield what there is to say."""
        yield f"as drawn: {built.theta_max_deg:.1f} deg, {built.f_max_n:.3f} N (PDC, 100 kPa)"
        yield self.wall_text
        if self.front is not None:
            yield from front_lines(self.front)
        for variable, of in self.ranks.items():
            told = ", ".join(f"{what} {value:+.2f}" for what, value in of.items())
            yield f"{variable}: partial rank correlation over the samples: {told}"
        for variable, of in ({} if self.alone is None else self.alone["trends"]).items():
            yield f"{variable} alone, rising: " + ", ".join(f"{what} {way}" for what, way in of.items())


def front_lines(front: dict[str, Any]) -> Iterator[str]:
    """Yield what a front offers, by its metamodel, by finite elements, and beside the paper's."""
    chosen = front["chosen"]
    yield f"front by {front['metamodel']}, over the drawing: {gains_text(front)}"
    checked = front.get("finite_elements")
    if checked is not None:
        yield f"{len(checked['designs'])} of its designs by finite elements, over the drawing: {gains_text(checked)}"
    yield (
        f"chosen by {chosen['rule']}: a {chosen['a_mm']:.3f}, b {chosen['b_mm']:.3f} mm, "
        f"{chosen['theta_deg']:.1f} deg, {chosen['f_n']:.3f} N"
    )
    paper = front.get("paper")
    if paper is None:
        return
    yield f"the paper's front (Eqs. 9 and 10), over its initial design: {gains_text(paper)}"
    for table, errors in paper["errors"].items():
        told = (
            f"{what} {errors[f'{key}_rms_pct']:.1f} % rms, {errors[f'{key}_mean_pct']:+.1f} mean, "
            f"{errors[f'{key}_worst_pct']:+.1f} worst"
            for key, what in (("theta", "bend"), ("force", "force"))
        )
        yield f"against the paper's finite elements, {table}, {errors['points']} designs: {'; '.join(told)}"


def gains_text(offered: dict[str, Any]) -> str:
    """Return two gains in words."""
    parts = []
    for key, what in (
        ("gain_force_at_equal_angle_pct", "force at equal angle"),
        ("gain_angle_at_equal_force_pct", "angle at equal force"),
    ):
        value = offered.get(key)
        parts.append(f"{what} {'not reached' if value is None else f'{value:+.1f} %'}")
    return ", ".join(parts)
