"""The gripper a user describes in ``config/gripper.yaml``: which muscles, and where they stand."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.actuator.built_muscle import LAW_FILE
from mbpam_ros.actuator.chambers import FINGER_COUNT
from mbpam_ros.actuator.design import MetamodelName, MuscleDesign, MuscleGeometry, uniform_geometry
from mbpam_ros.actuator.drawing import PAPER, load_drawing, muscle_folder
from mbpam_ros.actuator.named_designs import load_design
from mbpam_ros.configuration import ConfigError, load_yaml, parse_config, require_positive

if TYPE_CHECKING:
    from mbpam_ros.actuator.calibration import Calibration
    from mbpam_ros.actuator.rod_law import RodLaw


@dataclass(frozen=True)
class Gripper:
    """Four equal muscles hanging from a palm.

    Frame ``gripper_base``: origin in the palm's centre, z out of the palm along the hanging fingers. Fingers 1 to 4
    stand at azimuth 45, 135, 225, 315 deg with muscle frames parallel to ``gripper_base``.

    Args:
        design: the muscles' design.
        geometry: what all designs share.
        metamodel: surrogate that gives the design's greatest bend and force.
        target: scale to the paper's finite element values (fe), to its measured ones (test), or to what the rig
            measured of these muscles (measured). A muscle that is not the paper's has no test.
        finger_circle_radius_m: distance of the finger axes from the palm's centre.
        pressure_limit_gauge_pa: hard limit of any set-point.
        over_pressure_gauge_pa: a chamber above this vents at once; above the limit by more than overshoot and noise.
        muscle: name of the drawing that design and geometry come from, and of what was found out about it. Without it
            in the file, the paper's, of the design and geometry that the file gives.
        wall_m, wave_count: c, thickness of the chambers' wall, and waves of a muscle: of its drawing, else what the
            paper does not state and we read from it. Nothing but pictures depends on them here.
    """

    design: MuscleDesign
    geometry: MuscleGeometry
    metamodel: MetamodelName
    target: Literal["fe", "test", "measured"]
    finger_circle_radius_m: float
    pressure_limit_gauge_pa: float
    over_pressure_gauge_pa: float
    muscle: str = PAPER
    wall_m: float = 0.0023
    wave_count: float = 14.0

    def __post_init__(self) -> None:
        require_positive(self, "finger_circle_radius_m", "pressure_limit_gauge_pa", "wall_m", "wave_count")
        if self.muscle != PAPER and self.target == "test":
            raise ValueError(f"target test is the paper's muscle; for {self.muscle} take fe or measured")
        if not self.over_pressure_gauge_pa > self.pressure_limit_gauge_pa:
            raise ValueError(
                f"over_pressure_gauge_pa = {self.over_pressure_gauge_pa:g} must be above pressure_limit_gauge_pa = "
                f"{self.pressure_limit_gauge_pa:g}"
            )
        closest = 2.0 * self.finger_circle_radius_m * math.sin(math.pi / FINGER_COUNT)
        if closest < 2.0 * self.geometry.outer_radius_m:
            raise ValueError(
                f"finger_circle_radius_m = {self.finger_circle_radius_m:g} puts neighbouring fingers "
                f"{closest:g} m apart, less than their diameter"
            )

    @property
    def rod_geometry(self) -> MuscleGeometry:
        """Geometry of the uniform rod that stands for a muscle; the one that the calibrated law belongs to."""
        return uniform_geometry(self.geometry)

    def calibration(self) -> Calibration:
        """Return what the muscles run on.

        Raises:
            ConfigError: what the target asks for was not computed or measured.
            RodSolutionError: the design has no rod law.
        """
        from mbpam_ros.actuator import calibration  # a compiler, which most readers do without
        from mbpam_ros.actuator.measured_muscle import load_measured

        measured = load_measured(self.muscle) if self.target == "measured" else None
        base = self.target if measured is None else measured.base
        if self.muscle == PAPER:
            drawn = calibration.calibrate(self.design, self.geometry, self.metamodel, base)
        else:
            drawn = calibration.calibrate_built(self.muscle, self.geometry)
        return drawn if measured is None else calibration.calibrate_measured(drawn, self.geometry, measured)

    def rod_law(self) -> RodLaw:
        """Return the law of that rod.

        Raises:
            ConfigError, RodSolutionError: as :meth:`calibration`.
        """
        return self.calibration().law

    @property
    def gas_law(self) -> Path | None:
        """File of the chambers' gas volumes: the law of a muscle that was built; None for the paper's muscle."""
        return None if self.muscle == PAPER else muscle_folder(self.muscle) / LAW_FILE

    @property
    def finger_base_m(self) -> NDArray[np.float64]:
        """Clamp points of the four fingers in ``gripper_base``, shape (4, 3) [m]."""
        azimuth = np.radians(45.0 + 90.0 * np.arange(FINGER_COUNT))
        radius = self.finger_circle_radius_m
        return np.column_stack([radius * np.cos(azimuth), radius * np.sin(azimuth), np.zeros(FINGER_COUNT)])


def load_gripper(name: str | Path = "gripper.yaml") -> Gripper:
    """Read the gripper file ``name``.

    It names a ``muscle``, whose drawing then gives design and geometry, or gives both; ``design`` is a mapping of
    ``a_mm`` and ``b_mm``, or the name of a design.

    Raises:
        ConfigError: wrong keys or values; among them a design outside the paper's domain, and a name that no design or
            muscle has.
    """
    content = load_yaml(name)
    if "muscle" in content:
        given = [key for key in ("design", "geometry", "wall_m", "wave_count") if key in content]
        if given:
            raise ConfigError(f"{name}: muscle and {' and '.join(given)}: the drawing of the muscle gives these")
        try:
            drawing = load_drawing(str(content["muscle"]))
        except ConfigError as error:
            raise ConfigError(f"{name}: muscle: {error}") from error
        content |= {"design": drawing.design, "geometry": drawing.geometry}
        content |= {"wall_m": 1e-3 * drawing.c_mm, "wave_count": drawing.wave_count}
        content.setdefault("metamodel", "prs")
        return parse_config(Gripper, content, where=str(name))
    if isinstance(content.get("design"), str):
        try:
            design = load_design(content["design"])
        except ConfigError as error:
            raise ConfigError(f"{name}: design: {error}") from error
        content["design"] = asdict(design)
    if content.get("target") == "measured":
        raise ConfigError(f"{name}: target measured: say which muscle was measured, muscle: NAME instead of design")
    return parse_config(Gripper, content, where=str(name))
