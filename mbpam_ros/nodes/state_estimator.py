"""Node ``state_estimator``: measured pressures to bends, tip poses and available forces."""

from __future__ import annotations

import math
import sys
from dataclasses import replace
from typing import TYPE_CHECKING

from mbpam_ros.nodes.runtime import LATCHED, NEWEST, STREAM, GripperNode, Health, NodeOptions, run  # isort: skip
import numpy as np
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseArray, Vector3Stamped
from numpy.typing import NDArray
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray

from mbpam_ros.actuator.chambers import BEND_NAMES, CHANNEL_COUNT, CHANNEL_NAMES, FINGER_NAMES
from mbpam_ros.actuator.elastic_rod import HANGING
from mbpam_ros.actuator.equilibrium import GRAVITY_M_S2
from mbpam_ros.actuator.metamodel import metamodel_name
from mbpam_ros.actuator.planar_rod import RodSolutionError
from mbpam_ros.configuration import ConfigError, load_config
from mbpam_ros.description.frames import Frames, orientation_of
from mbpam_ros.description.urdf import gripper_urdf
from mbpam_ros.description.wave_mesh import WaveError
from mbpam_ros.estimation.estimator import BendEstimator, EstimatorConfig, GripperEstimate
from mbpam_ros.gripper import load_gripper
from mbpam_ros.nodes.markers import finger_markers
from mbpam_ros.nodes.messages import JointStateForm, MessageError, direction, named_values, pose, seconds
from mbpam_ros.nodes.parameters import Parameter
from mbpam_ros.nodes.transforms import FRAME_PREFIX, Placed, TransformBroadcaster
from mbpam_ros.vision.camera import CameraPose, camera_pose, load_camera_config

if TYPE_CHECKING:
    from typing_extensions import Unpack

PARAMETERS = (
    Parameter("gripper", "gripper.yaml", "gripper file: design, metamodel, target and layout"),
    Parameter("estimator", "estimator.yaml", "estimator file: lag of the bend, drawn points"),
    Parameter("metamodel", "", "prs, rbf, krg, rbf_gaussian or krg_nugget; empty: as the gripper file says"),
    Parameter("pressure_sigma_pa", 100.0, "one sigma of a measured pressure [Pa]", 0.0, 1e5, changeable=True),
    Parameter("marker_rate_hz", 10.0, "rate of finger_markers [Hz]", 0.1, 100.0),
    Parameter("camera", "camera.yaml", "camera file: its pose, for robot_description and TF"),
    FRAME_PREFIX,
)

STALE_S = 0.5
"""Without pressures for longer than this the state of the fingers is not known."""


class StateEstimatorNode(GripperNode):
    """Adapter around :class:`BendEstimator`."""

    def __init__(self, **node_options: Unpack[NodeOptions]) -> None:
        super().__init__("state_estimator", PARAMETERS, **node_options)
        gripper = load_gripper(self.text("gripper"))
        metamodel = self.text("metamodel") or gripper.metamodel
        config = load_config(EstimatorConfig, self.text("estimator"))
        try:
            self._gripper = replace(gripper, metamodel=metamodel_name(metamodel))
            self._estimator = BendEstimator.for_gripper(self._gripper, config)
        except (ValueError, RodSolutionError) as error:
            place = f"{self.value('gripper')}, metamodel {metamodel}"
            raise ConfigError(f"{place}: no rod law for this muscle: {error}") from error
        self._frames = Frames(self.text("frame_prefix"))
        self._estimate: GripperEstimate | None = None
        self._received_s = -math.inf
        self._gravity_m_s2 = np.array(HANGING)

        self._joints = self.create_publisher(JointState, "joint_states", STREAM)
        self._tips = self.create_publisher(PoseArray, "finger_tips", STREAM)
        self._forces = self.create_publisher(JointState, "finger_forces", STREAM)
        self._markers = self.create_publisher(MarkerArray, "finger_markers", STREAM)
        self._bends, self._tip_forces = JointStateForm(BEND_NAMES), JointStateForm(FINGER_NAMES)
        self.create_subscription(JointState, "chamber_states", self._on_chamber_states, NEWEST)
        self.create_subscription(Vector3Stamped, "gravity", self._on_gravity, NEWEST)
        self._marker_rate_hz, self._drawn_period = self.number("marker_rate_hz"), -1
        self._transforms = TransformBroadcaster(self)
        self._description = self.create_publisher(String, "robot_description", LATCHED)
        self._describe(camera_pose(load_camera_config(self.text("camera"))))

    def health(self) -> Health:
        """ERROR while a finger's state is not known."""
        values: dict[str, str] = {"metamodel": self._gripper.metamodel, "target": self._gripper.target}
        if self._estimate is None:
            return Health(DiagnosticStatus.ERROR, "no pressures received on 'chamber_states'", values)
        if self._is_stale():
            return Health(DiagnosticStatus.ERROR, f"no pressures on 'chamber_states' for {STALE_S:g} s", values)
        unknown = np.flatnonzero(np.isnan(self._estimate.bend_rad).any(axis=1))
        if len(unknown):
            names = ", ".join(FINGER_NAMES[i] for i in unknown)
            return Health(DiagnosticStatus.ERROR, f"state not known: {names}", values)
        values["bend_sigma_max_deg"] = f"{np.degrees(self._bend_sigma_rad(self._estimate).max()):.2f}"
        return Health(message="4 fingers estimated", values=values)

    def _describe(self, camera: CameraPose) -> None:
        """Publish what does not change: the URDF, and the frames that are fixed to the palm."""
        base, frames = self._frames.base, self._frames
        try:
            urdf = gripper_urdf(self._gripper, camera.rotation, camera.position_m, frames)
        except WaveError as error:
            raise ConfigError(f"{self.value('gripper')}: {error}") from error
        self._description.publish(String(data=urdf))
        upright = (0.0, 0.0, 0.0, 1.0)
        placed = zip(frames.mounts, self._gripper.finger_base_m, strict=True)
        mounts = [Placed(base, name, position_m, upright) for name, position_m in placed]
        optical = Placed(base, frames.camera_optical, camera.position_m, orientation_of(camera.rotation))
        self._transforms.send_once(self.now_stamp(), [optical, *mounts])

    def _is_stale(self) -> bool:
        return self.now_s() - self._received_s > STALE_S

    def _bend_sigma_rad(self, estimate: GripperEstimate) -> NDArray[np.float64]:
        variance_pa2 = np.full(CHANNEL_COUNT, self.number("pressure_sigma_pa") ** 2)
        return self._estimator.bend_sigma_rad(estimate, variance_pa2)

    def _on_chamber_states(self, message: JointState) -> None:
        try:
            pressure_gauge_pa = named_values(message, CHANNEL_NAMES, "effort")
            stamp_s = seconds(message.header.stamp)
            self._estimate = self._estimator.update(stamp_s, pressure_gauge_pa, self._gravity_m_s2)
            self._received_s = self.now_s()
        except (MessageError, ValueError) as error:
            self.refuse("chamber_states", error)
            return
        self._publish(message.header.stamp, self._estimate)
        self.publish_health_change(np.isnan(self._estimate.bend_rad).tobytes())

    def _on_gravity(self, message: Vector3Stamped) -> None:
        try:
            self._gravity_m_s2 = GRAVITY_M_S2 * direction(message, self._frames.base)
        except MessageError as error:
            self.refuse("gravity", error)

    def _publish(self, stamp: Time, estimate: GripperEstimate) -> None:
        """Publish the estimate where anybody listens: the messages cost as much as the estimate itself."""
        if self._joints.get_subscription_count() > 0:
            bend, rate, moment = (
                field.reshape(-1) for field in (estimate.bend_rad, estimate.bend_rate_rad_s, estimate.moment_n_m)
            )
            self._joints.publish(self._bends.filled(stamp, position=bend, velocity=rate, effort=moment))
        if self._forces.get_subscription_count() > 0:
            self._forces.publish(
                self._tip_forces.filled(
                    stamp,
                    position=self._bend_sigma_rad(estimate),
                    effort=self._estimator.tip_force_n(estimate.moment_n_m),
                )
            )
        if self._transforms.active or self._tips.get_subscription_count() > 0:
            self._publish_tips(stamp, list(zip(*self._estimator.tips(estimate), strict=True)))
        # By the stamps, not by a timer: what is drawn of a moment does not depend on what comes first.
        period = math.floor(seconds(stamp) * self._marker_rate_hz + 1e-6)
        if period != self._drawn_period and self._markers.get_subscription_count() > 0:
            self._drawn_period = period
            self._publish_markers(stamp, estimate)

    def _publish_tips(self, stamp: Time, tips: list[tuple[NDArray[np.float64], NDArray[np.float64]]]) -> None:
        message = PoseArray(poses=[pose(*tip) for tip in tips])
        message.header.stamp, message.header.frame_id = stamp, self._frames.base
        self._tips.publish(message)
        known = [
            Placed(self._frames.base, name, *tip)
            for name, tip in zip(self._frames.tips, tips, strict=True)
            if np.isfinite(tip[0]).all()
        ]
        self._transforms.send(stamp, known)

    def _publish_markers(self, stamp: Time, estimate: GripperEstimate) -> None:
        lines = self._estimator.centrelines(estimate)
        radius_m = self._gripper.geometry.outer_radius_m
        markers = finger_markers(stamp, self._frames.base, lines, radius_m, (0.2, 0.6, 1.0))
        self._markers.publish(MarkerArray(markers=markers))


def main() -> int:
    """Run the node until a signal."""
    return run(StateEstimatorNode)


if __name__ == "__main__":
    sys.exit(main())
