"""What the nodes say to each other: the topics and services of a gripper, as data.

``--help`` prints it, and a test holds it against the running graph. Names are relative to the gripper's namespace.
"""

from __future__ import annotations

from dataclasses import dataclass

from mbpam_ros.actuator.chambers import CHAMBERS_PER_FINGER, FINGER_COUNT
from mbpam_ros.grasp.modes import MODE_NAMES

NODES = ("plant", "pressure_sensor", "valve_controller", "state_estimator", "object_detector", "grasp_arbiter")
"""The nodes of a gripper, in the order of the data flow."""

TRIGGER, SET_BOOL = "std_srvs/srv/Trigger", "std_srvs/srv/SetBool"
_JOINTS, _MARKERS = "sensor_msgs/msg/JointState", "visualization_msgs/msg/MarkerArray"
_STATUS, _HEADER = "diagnostic_msgs/msg/DiagnosticStatus", "std_msgs/msg/Header"
_WATCHED_BY = {
    "grasp_arbiter": ("valve_controller",),
    "pressure_sensor": ("grasp_arbiter",),
    "valve_controller": ("grasp_arbiter",),
    "object_detector": ("grasp_arbiter",),
}
"""Who depends on a node, and so listens whether it lives; each also listens for another node of its own name."""


@dataclass(frozen=True)
class Topic:
    """One topic.

    Args:
        name: relative; ``<f>`` and ``<c>`` stand for the numbers of a finger and a chamber.
        message_type: its ROS type.
        meaning: which field holds what, with units.
        publishers: nodes that send it; on a robot drivers send what the plant does.
        subscribers: nodes that listen.
        latched: whether a late subscriber gets the last message.
    """

    name: str
    message_type: str
    meaning: str
    publishers: tuple[str, ...]
    subscribers: tuple[str, ...] = ()
    latched: bool = False

    @property
    def names(self) -> tuple[str, ...]:
        """All names that the name stands for."""
        if "<f>" not in self.name:
            return (self.name,)
        return tuple(
            self.name.replace("<f>", str(finger)).replace("<c>", str(chamber))
            for finger in range(1, FINGER_COUNT + 1)
            for chamber in range(1, CHAMBERS_PER_FINGER + 1)
        )


@dataclass(frozen=True)
class Service:
    """One service.

    Args:
        name: relative.
        service_type: its ROS type.
        node: who serves it.
        meaning: what it does.
        callers: nodes that call it, beside operators.
    """

    name: str
    service_type: str
    node: str
    meaning: str
    callers: tuple[str, ...] = ()


TOPICS = (
    Topic("transducers", _JOINTS, "effort: transducer voltage [V], 100 Hz", ("plant",), ("pressure_sensor",)),
    Topic(
        "chamber_states",
        _JOINTS,
        "effort: gauge pressure [Pa], NaN = no valid reading, 100 Hz",
        ("pressure_sensor",),
        ("valve_controller", "state_estimator", "grasp_arbiter"),
    ),
    Topic(
        "chamber_<f>_<c>/pressure",
        "sensor_msgs/msg/FluidPressure",
        "absolute pressure [Pa] and variance of a valid channel, 10 Hz",
        ("pressure_sensor",),
    ),
    Topic(
        "pressure_setpoints", _JOINTS, "effort: wanted gauge pressure [Pa]", ("grasp_arbiter",), ("valve_controller",)
    ),
    Topic(
        "valve_commands",
        _JOINTS,
        "position: spool opening, -1 (vent) to +1 (fill), 100 Hz; name supply: 1 open, 0 shut and dumped",
        ("valve_controller",),
        ("plant",),
    ),
    Topic(
        "joint_states",
        _JOINTS,
        "finger_i_bend_x, _y: position [rad], velocity [rad/s], effort [N m]; NaN = not known",
        ("state_estimator",),
    ),
    Topic(
        "robot_description",
        "std_msgs/msg/String",
        "URDF: fingers as chains that joint_states moves; links carry frame_prefix",
        ("state_estimator",),
        latched=True,
    ),
    Topic("finger_tips", "geometry_msgs/msg/PoseArray", "tip poses in gripper_base", ("state_estimator",)),
    Topic(
        "finger_forces",
        _JOINTS,
        "effort: available tip force [N]; position: 1 sigma of the bend [rad]",
        ("state_estimator",),
    ),
    Topic("finger_markers", _MARKERS, "estimated shapes", ("state_estimator",), ("object_detector",)),
    Topic("plant/finger_markers", _MARKERS, "true shapes", ("plant",)),
    Topic(
        "gravity",
        "geometry_msgs/msg/Vector3Stamped",
        "direction in which gravity pulls, in gripper_base; until one comes, the gripper hangs, or as the scene says",
        (),
        ("plant", "state_estimator"),
    ),
    Topic("camera/image_raw", "sensor_msgs/msg/Image", "rgb8 image of the palm", ("plant",), ("object_detector",)),
    Topic("camera/camera_info", "sensor_msgs/msg/CameraInfo", "its lens", ("plant",), ("object_detector",)),
    Topic(
        "camera/depth/image_raw",
        "sensor_msgs/msg/Image",
        "32FC1 [m] or 16UC1 [mm], rectified; optional, from a depth camera at the same place",
        ("plant",),
        ("object_detector",),
    ),
    Topic("camera/depth/camera_info", "sensor_msgs/msg/CameraInfo", "its lens", ("plant",), ("object_detector",)),
    Topic(
        "detections",
        _MARKERS,
        "shape, size [m], pose in gripper_base; color.a: confidence; points: how far a length seen in part may reach",
        ("object_detector",),
        ("grasp_arbiter",),
    ),
    Topic("detections/image", "sensor_msgs/msg/CompressedImage", "overlay to look at", ("object_detector",)),
    Topic(
        "grasp_state",
        _STATUS,
        "phase, mode, source, object, contact, holding, air, reason; from the first pressures on",
        ("grasp_arbiter",),
        ("valve_controller",),
        latched=True,
    ),
    Topic(
        "valve_controller/state",
        _STATUS,
        "air, enabled, vent_latched: why a vent is latched, empty where none is",
        ("valve_controller",),
        ("grasp_arbiter",),
        latched=True,
    ),
    Topic(
        "grasp_pose",
        "geometry_msgs/msg/PoseStamped",
        "wrist pose that lines the mode up with the object",
        ("grasp_arbiter",),
        latched=True,
    ),
    Topic(
        "scale/wrench",
        "geometry_msgs/msg/WrenchStamped",
        "force.z [N] on the plate of the measuring rig; the plant's scene rig alone sends it",
        ("plant",),
    ),
    Topic(
        "rig/mount",
        _JOINTS,
        "position of turn: azimuth of the muscle that bends to the right [rad], of plate: at the tip 1, away 0",
        (),
        ("plant",),
        latched=True,
    ),
    *(
        Topic(
            f"{node}/alive",
            _HEADER,
            "frame_id: host, process and run of the node; 20 Hz",
            (node,),
            (node, *_WATCHED_BY.get(node, ())),
        )
        for node in NODES
    ),
)
"""All but ``/diagnostics``, on which every node reports its health, the plant's ``/clock``, and, where tf2_msgs is
installed, ``/tf`` and ``/tf_static``."""

SERVICES = (
    *(Service(f"grasp/{mode}", TRIGGER, "grasp_arbiter", f"close in the mode {mode}") for mode in MODE_NAMES),
    Service("grasp/auto", TRIGGER, "grasp_arbiter", "let the camera choose the mode"),
    Service("grasp/release", TRIGGER, "grasp_arbiter", "open"),
    Service("grasp/check", TRIGGER, "grasp_arbiter", "the hand is up: say held, empty or unknown, and by which sense"),
    Service("grasp/stop", TRIGGER, "grasp_arbiter", "vent everything at once and latch a fault"),
    Service("grasp/reset", TRIGGER, "grasp_arbiter", "clear a latched fault"),
    Service("valve_controller/enable", SET_BOOL, "valve_controller", "air on or off"),
    Service(
        "valve_controller/vent",
        TRIGGER,
        "valve_controller",
        "vent everything at once, latched; needs no arbiter",
        ("grasp_arbiter",),
    ),
    Service(
        "valve_controller/clear",
        TRIGGER,
        "valve_controller",
        "lift a latched vent; grasp/reset calls it",
        ("grasp_arbiter",),
    ),
    Service("object_detector/learn_background", TRIGGER, "object_detector", "take the next images as the empty table"),
    Service("pressure_sensor/zero", TRIGGER, "pressure_sensor", "take the vented reading as zero"),
    Service("plant/reset", TRIGGER, "plant", "put the scene back to its start"),
    Service("plant/lift", TRIGGER, "plant", "raise the hand"),
    Service("plant/lower", TRIGGER, "plant", "lower the hand"),
)
