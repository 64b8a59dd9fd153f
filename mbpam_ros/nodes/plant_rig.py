"""The measuring rig in the simulated plant: finger 1 in a clamp, a camera at its side, a scale at its tip."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import WrenchStamped
from numpy.typing import NDArray
from rclpy.publisher import Publisher
from sensor_msgs.msg import JointState

from mbpam_ros.gripper import Gripper
from mbpam_ros.nodes.messages import MessageError, named_values
from mbpam_ros.nodes.plant_camera import PlantCamera
from mbpam_ros.nodes.runtime import GripperNode
from mbpam_ros.plant.plant import Observation
from mbpam_ros.plant.rig import MuscleRig, RigConfig, hidden_muscle
from mbpam_ros.vision.render import ColouredSolid, SceneView
from mbpam_ros.vision.side_markers import marker_strips

MOUNT = ("turn", "plate")
"""What ``rig/mount`` says, as positions: azimuth that bends to the right [rad]; plate at the tip 1, away 0."""

SCALE_FRAME = "scale"
_AXIS_SAG_M = 2e-5
_TO_CAMERA = np.array([0.0, -1.0, 0.0])


class RigCamera(PlantCamera):
    """The camera at the side: sees the one muscle alone, before a dark ground."""

    marker_rgb: tuple[float, float, float] | None = None
    """Of the strips at the muscle's ends, if it has any."""

    def _view(self, observation: Observation) -> SceneView:
        strips: tuple[ColouredSolid, ...] = ()
        if self.marker_rgb is not None:
            strips = marker_strips(observation.centreline_m[0], self._finger_radius_m, _TO_CAMERA, self.marker_rgb)
        return SceneView(
            math.inf,
            strips,
            finger_centrelines_m=observation.centreline_m,
            finger_radius_m=self._finger_radius_m,
            finger_sag_m=_AXIS_SAG_M,
        )


class PlantRig:
    """Adapter around :class:`~mbpam_ros.plant.rig.MuscleRig`.

    Args:
        node: publishes for it; its parameter ``seed`` is read.
        gripper: whose muscle is drawn.
        config: of the scene's rig, says who is hidden.
        scale: where the scale's readings go.
    """

    def __init__(self, node: GripperNode, gripper: Gripper, config: RigConfig, scale: Publisher) -> None:
        muscle = hidden_muscle(gripper.rod_law(), config)
        self._rig = MuscleRig(muscle, gripper.rod_geometry, config, node.whole("seed"))
        self._scale, self._wrench = scale, WrenchStamped()
        self._wrench.header.frame_id = SCALE_FRAME

    def step(self, pressure_gauge_pa: NDArray[np.float64], dt_s: float) -> None:
        """Let the pressures (4,) of the mounted muscle act."""
        self._rig.step(pressure_gauge_pa, dt_s)

    def weigh(self, stamp: Time) -> None:
        """Publish what the scale shows, if anybody looks.

        Raises:
            RodSolutionError: the muscle has no equilibrium.
        """
        if self._scale.get_subscription_count() > 0:
            self._wrench.header.stamp = stamp
            self._wrench.wrench.force.z = self._rig.scale_n()
            self._scale.publish(self._wrench)

    def seen(self, observation: Observation) -> Observation:
        """Return the observation with the mounted muscle, in the rig's frame, for all fingers.

        Raises:
            RodSolutionError: the muscle has no equilibrium.
        """
        return dataclasses.replace(observation, centreline_m=self._rig.axis_m()[None])

    def mount(self, message: JointState) -> None:
        """Put the muscle up as ``rig/mount`` says.

        Raises:
            MessageError: the message does not say how.
        """
        turn_rad, plate = named_values(message, MOUNT, "position").tolist()
        if not (math.isfinite(turn_rad) and plate in (0.0, 1.0)):
            raise MessageError("turn must be finite, plate 0 or 1")
        self._rig.mount(turn_rad, with_plate=plate == 1.0)
