"""The hand as a scene in a browser: what the topics told last is drawn, at most :data:`FRAME_S` after the frame before.

What comes is kept, and only what changed is drawn; the server sends it in threads of its own, so that a slow browser
holds up neither this process nor, which is another one anyway, a node.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from mbpam_ros.nodes.runtime import NEWEST, STREAM  # isort: skip
import cv2
import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from numpy.typing import NDArray
from sensor_msgs.msg import CompressedImage, JointState
from visualization_msgs.msg import Marker, MarkerArray

from mbpam_ros.actuator.chambers import CHAMBER_AZIMUTH_RAD, CHAMBERS_PER_FINGER, CHANNEL_COUNT, FINGER_COUNT
from mbpam_ros.commands.system import Operator
from mbpam_ros.description.centreline import places_along
from mbpam_ros.description.frames import HANGING_XYZW
from mbpam_ros.description.urdf import PALM_THICKNESS_M
from mbpam_ros.description.wave_mesh import Wave, wave_count, wave_triangles
from mbpam_ros.gripper import Gripper

if TYPE_CHECKING:
    from viser import SceneNodeHandle, ViserServer

FRAME_S = 1.0 / 30.0
EYE_M, LOOKED_AT_M = (0.20, -0.28, 0.02), (0.0, 0.0, -0.06)
ARC_POINTS, SLICES = 5, 7
"""Of a drawn wave: fewer triangles than the mesh of the URDF, for computers that draw by themselves."""

PLOT_PERIOD_S = 0.2
PLOTTED_S = 20.0
SAMPLE_PERIOD_S = 0.1
LEVELS = {DiagnosticStatus.OK: "ok", DiagnosticStatus.WARN: "**warning**", DiagnosticStatus.ERROR: "**error**"}
SILICONE, TRUTH, OBJECT, FOUND = (60, 150, 230), (205, 210, 215), (240, 165, 60), (90, 200, 110)
FINGER_COLOURS = ("#1f77b4", "#d62728", "#2ca02c", "#9467bd")


class Viewer:
    """Draws one gripper.

    Args:
        operator: whose node listens.
        server: the page.
        gripper: the sizes that are drawn.
    """

    def __init__(self, operator: Operator, server: ViserServer, gripper: Gripper) -> None:
        self._operator, self._gripper = operator, gripper
        self._scene, self._gui = server.scene, server.gui
        server.initial_camera.position, server.initial_camera.look_at = EYE_M, LOOKED_AT_M
        self._news: dict[str, Any] = {}
        self._pressures: deque[tuple[float, NDArray[np.float64], float]] = deque()
        self._setpoint_pa, self._pressure_pa = np.zeros(CHANNEL_COUNT), np.full(CHANNEL_COUNT, np.nan)
        self._plotted_at_s, self._began_s = 0.0, time.monotonic()
        self._told: dict[str, str] = {}
        self._solids: dict[str, tuple[tuple[float, ...], SceneNodeHandle]] = {}
        self._build_scene()
        self._build_panel()
        for message_type, topic, qos in (
            (MarkerArray, "finger_markers", STREAM),
            (MarkerArray, "plant/finger_markers", STREAM),
            (MarkerArray, "detections", STREAM),
            (CompressedImage, "detections/image", STREAM),
            (JointState, "chamber_states", NEWEST),
            (JointState, "pressure_setpoints", STREAM),
        ):
            operator.node.create_subscription(message_type, topic, self._keep(topic), qos)

    def draw(self) -> bool:
        """Bring the page up to date with what came since the last call; return whether fingers were drawn anew."""
        news, self._news = self._news, {}
        for topic, update in (
            ("finger_markers", self._draw_estimate),
            ("plant/finger_markers", self._draw_truth),
            ("detections", self._draw_detections),
            ("detections/image", self._draw_image),
            ("chamber_states", self._take_pressures),
            ("pressure_setpoints", self._take_setpoints),
        ):
            if topic in news:
                update(news[topic])
        if time.monotonic() - self._plotted_at_s > PLOT_PERIOD_S:
            self._plotted_at_s = time.monotonic()
            self._plot()
            self._tell()
        return "finger_markers" in news

    def _keep(self, topic: str) -> Callable[[Any], None]:
        return lambda message: self._news.__setitem__(topic, message)

    # Scene

    def _build_scene(self) -> None:
        geometry, scene = self._gripper.geometry, self._scene
        scene.set_up_direction("+z")
        scene.add_grid("/floor", width=0.6, height=0.6, cell_size=0.05, position=(0.0, 0.0, -0.2))
        x, y, z, w = HANGING_XYZW
        self._hand = scene.add_frame("/hand", show_axes=False, wxyz=(w, x, y, z))
        width_m = 2.0 * (np.abs(self._gripper.finger_base_m[:, :2]).max() + geometry.outer_radius_m)
        size_m = (width_m, width_m, PALM_THICKNESS_M)
        scene.add_box("/hand/palm", (75, 75, 80), size_m, position=(0.0, 0.0, -0.5 * PALM_THICKNESS_M))
        self._end_share = geometry.end_length_m / geometry.length_m
        wave = Wave.of_gripper(self._gripper, geometry.active_length_m / wave_count(self._gripper))
        end = Wave(geometry.outer_radius_m, 1e-6, wave.cross_m, wave.wall_m, geometry.end_length_m)
        self._shapes = [self._finger_shapes(root, wave, end) for root in ("/hand", "/truth")]
        chambers = np.array([np.cos(CHAMBER_AZIMUTH_RAD), np.sin(CHAMBER_AZIMUTH_RAD), 0.0 * CHAMBER_AZIMUTH_RAD]).T
        lamps = self._gripper.finger_base_m[:, None, :] + 0.6 * geometry.outer_radius_m * chambers
        lamps[..., 2] = -PALM_THICKNESS_M
        lamp = wave_triangles(Wave(0.003, 1e-6, 1e-4, 1e-3, 0.004), ARC_POINTS, 2).reshape(-1, 3)
        self._lamps = scene.add_batched_meshes_simple(
            "/hand/chambers",
            lamp,
            np.arange(len(lamp)).reshape(-1, 3),
            _upright(CHANNEL_COUNT),
            lamps.reshape(-1, 3),
            batched_colors=np.full((CHANNEL_COUNT, 3), 90, dtype=np.uint8),
        )

    def _finger_shapes(self, root: str, wave: Wave, end: Wave) -> list[tuple[Any, NDArray[np.float64]]]:
        """Waves and ends of four fingers, hidden until their line is known, and where along it they lie."""
        first, last = self._end_share, 1.0 - self._end_share
        waves = wave_count(self._gripper)
        shares = first + (last - first) * (np.arange(waves) + 0.5) / waves
        shapes = []
        for name, piece, places in (("waves", wave, shares), ("ends", end, np.array([0.5 * first, 0.5 * (1 + last)]))):
            corners, count = wave_triangles(piece, ARC_POINTS, SLICES).reshape(-1, 3), FINGER_COUNT * len(places)
            handle = self._scene.add_batched_meshes_simple(
                f"{root}/{name}",
                corners,
                np.arange(len(corners)).reshape(-1, 3),
                _upright(count),
                np.zeros((count, 3)),
                batched_colors=SILICONE if root == "/hand" else TRUTH,
                opacity=1.0 if root == "/hand" else 0.35,
                visible=False,
            )
            shapes.append((handle, places))
        return shapes

    def _draw_estimate(self, message: MarkerArray) -> None:
        self._draw_fingers(0, message)

    def _draw_truth(self, message: MarkerArray) -> None:
        self._draw_fingers(1, message)
        for marker in message.markers:
            if marker.ns == "palm":
                position = marker.pose.position
                self._hand.position = (position.x, position.y, position.z - 0.5 * PALM_THICKNESS_M)
            elif marker.ns != "finger":
                self._draw_solid(f"/object_{marker.id}", marker, OBJECT, 1.0)

    def _draw_fingers(self, which: int, message: MarkerArray) -> None:
        fingers = [marker for marker in message.markers if marker.ns == "finger" and marker.action == Marker.ADD]
        lines = [[(point.x, point.y, point.z) for point in marker.points] for marker in fingers]
        for handle, _ in self._shapes[which]:
            handle.visible = len(lines) == FINGER_COUNT
        if len(lines) != FINGER_COUNT:
            return
        shares = [shares for _, shares in self._shapes[which]]
        ends = np.cumsum([len(each) for each in shares])[:-1]
        placed = (np.split(each, ends, axis=1) for each in places_along(np.array(lines), np.concatenate(shares)))
        for (handle, _), positions, turns in zip(self._shapes[which], *placed, strict=True):
            handle.batched_positions, handle.batched_wxyzs = positions.reshape(-1, 3), turns.reshape(-1, 4)

    def _draw_detections(self, message: MarkerArray) -> None:
        found = [marker for marker in message.markers if marker.action == Marker.ADD]
        for number, marker in enumerate(found):
            self._draw_solid(f"/hand/found_{number}", marker, FOUND, 0.4)
        for name in [name for name in self._solids if name.startswith("/hand/found_")]:
            self._solids[name][1].visible = int(name.rpartition("_")[2]) < len(found)

    def _draw_solid(self, name: str, marker: Marker, colour: tuple[int, int, int], opacity: float) -> None:
        """Move a solid; make it anew only if its shape or size is another: browsers show what is new at the origin."""
        position, turn, scale = marker.pose.position, marker.pose.orientation, marker.scale
        shape = marker.type, *(round(value, 3) for value in (scale.x, scale.y, scale.z))
        if name not in self._solids or self._solids[name][0] != shape:
            self._solids[name] = shape, self._new_solid(name, marker, colour, opacity)
        handle = self._solids[name][1]
        handle.position = (position.x, position.y, position.z)
        handle.wxyz = (turn.w, turn.x, turn.y, turn.z)

    def _new_solid(self, name: str, marker: Marker, colour: tuple[int, int, int], opacity: float) -> SceneNodeHandle:
        scale, scene = marker.scale, self._scene
        if marker.type == Marker.SPHERE:
            return scene.add_icosphere(name, 0.5 * scale.x, colour, opacity=opacity)
        if marker.type == Marker.CYLINDER:
            return scene.add_cylinder(name, 0.5 * scale.x, scale.z, colour, opacity=opacity)
        return scene.add_box(name, colour, (scale.x, scale.y, scale.z), opacity=opacity)

    # Panel

    def _build_panel(self) -> None:
        from viser import uplot

        self._state = self._gui.add_markdown("no word of the gripper yet", order=0.0)
        with self._gui.add_folder("Camera", order=2.0):
            self._image = self._gui.add_image(np.zeros((48, 80, 3), dtype=np.uint8))
        with self._gui.add_folder("Pressures [kPa]", order=3.0):
            names = [f"f{i // CHAMBERS_PER_FINGER + 1} c{i % CHAMBERS_PER_FINGER + 1}" for i in range(CHANNEL_COUNT)]
            series = [uplot.Series(label="time [s]")]
            series += [
                uplot.Series(label=name, stroke=FINGER_COLOURS[i // CHAMBERS_PER_FINGER], width=1)
                for i, name in enumerate(names)
            ]
            series += [
                uplot.Series(label="set-point", stroke="black", width=2),
                uplot.Series(label="limit", stroke="red"),
            ]
            self._plotted = self._gui.add_uplot(
                self._curves(), tuple(series), height=220, legend=uplot.Legend(show=False)
            )
        with self._gui.add_folder("Nodes", order=4.0):
            self._nodes = self._gui.add_markdown("")

    def _draw_image(self, message: CompressedImage) -> None:
        image = cv2.imdecode(np.frombuffer(message.data, np.uint8), cv2.IMREAD_COLOR)
        if image is not None:
            self._image.image = image[:, :, ::-1]

    def _take_pressures(self, message: JointState) -> None:
        self._pressure_pa = np.array(message.effort)
        now_s = time.monotonic() - self._began_s
        if not self._pressures or now_s - self._pressures[-1][0] >= SAMPLE_PERIOD_S:
            self._pressures.append((now_s, self._pressure_pa, float(self._setpoint_pa.max())))
        while self._pressures[0][0] < now_s - PLOTTED_S:
            self._pressures.popleft()
        share = np.clip(np.nan_to_num(self._pressure_pa) / self._gripper.pressure_limit_gauge_pa, 0.0, 1.0)[:, None]
        colours = 255.0 * (share * (1.0, 0.25, 0.15) + (1.0 - share) * (0.25, 0.3, 0.4))
        self._lamps.batched_colors = colours.astype(np.uint8)

    def _take_setpoints(self, message: JointState) -> None:
        self._setpoint_pa = np.array(message.effort)

    def _plot(self) -> None:
        self._plotted.data = self._curves()

    def _curves(self) -> tuple[NDArray[np.float64], ...]:
        rows = [(time_s, *pressure_pa, setpoint_pa) for time_s, pressure_pa, setpoint_pa in self._pressures]
        columns = np.array(rows or [(0.0, *np.zeros(CHANNEL_COUNT), 0.0)]).T
        limit = np.full(columns.shape[1], self._gripper.pressure_limit_gauge_pa)
        return (columns[0], *(1e-3 * column for column in (*columns[1:], limit)))

    def _tell(self) -> None:
        grasp = self._operator.grasp
        state = "no word of the arbiter yet"
        if grasp:
            state = f"### {grasp['phase']}\n{grasp.get('reason', '')}\n\n" + ", ".join(
                f"{key} {grasp[key]}" for key in ("mode", "contact", "holding", "air") if grasp.get(key)
            )
        nodes = "\n".join(
            f"- {name}: {LEVELS.get(level, 'stale')}, {message}"
            for name, (level, message, _) in sorted(self._operator.health.items())
        )
        for handle, name, text in ((self._state, "state", state), (self._nodes, "nodes", nodes)):
            if self._told.get(name) != text:  # a text that is set anew is drawn anew
                self._told[name] = handle.content = text


def _upright(count: int) -> NDArray[np.float64]:
    return np.tile([1.0, 0.0, 0.0, 0.0], (count, 1))
