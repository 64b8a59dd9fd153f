"""``mbpam view``: what the topics tell is put where it belongs on the page, which shows only unless told otherwise."""

import queue
import sys
from collections import defaultdict
from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pytest

from mbpam_ros.commands import view  # isort: skip
from builtin_interfaces.msg import Time
from sensor_msgs.msg import JointState
from visualization_msgs.msg import MarkerArray

from mbpam_ros.actuator.chambers import CHANNEL_NAMES
from mbpam_ros.actuator.kinematics import centreline, tip_pose
from mbpam_ros.commands.viewer import Viewer
from mbpam_ros.description.centreline import places_along
from mbpam_ros.description.wave_mesh import wave_count
from mbpam_ros.gripper import load_gripper
from mbpam_ros.nodes.interface import SERVICES
from mbpam_ros.nodes.markers import colour, finger_markers, solid_marker
from mbpam_ros.nodes.messages import joint_state

GRIPPER = load_gripper()
ROD, WAVES = GRIPPER.rod_geometry, wave_count(GRIPPER)


def line_of(bend):
    return centreline(bend, ROD, np.linspace(0.0, ROD.length_m, 200))


def markers_of(bend):
    lines = line_of(bend) + GRIPPER.finger_base_m[:, None, :]
    return finger_markers(Time(), "gripper_base", lines, 0.01, (1, 1, 1))


class Page:
    """What a Viewer asks of viser's server, and what it made of it by name."""

    def __init__(self, monkeypatch):
        monkeypatch.setitem(sys.modules, "viser", MagicMock())
        self.made = defaultdict(MagicMock)
        make = lambda name, *_, **__: self.made[name]  # noqa: E731
        self.server = MagicMock()
        for kind in ("frame", "box", "icosphere", "cylinder", "batched_meshes_simple"):
            getattr(self.server.scene, f"add_{kind}").side_effect = make
        self.heard = {}
        subscribe = lambda _, topic, callback, __: self.heard.__setitem__(topic, callback)  # noqa: E731
        operator = SimpleNamespace(
            node=SimpleNamespace(create_subscription=subscribe),
            grasp={"phase": "closing", "reason": "asked for"},
            health={"/plant": (b"\x02", "diverged", {})},
        )
        self.viewer = Viewer(operator, self.server, GRIPPER)

    def show(self, topic, message):
        self.heard[topic](message)
        self.viewer.draw()


@pytest.mark.parametrize("bend", [(0.0, 0.0), (1.2, -0.5), (-2.0, 0.0)])
def test_pieces_lie_along_the_arc_and_turn_with_it(bend):
    positions, turns = places_along(line_of(bend), [0.0, 0.5, 1.0])
    tip_m, tip_xyzw = tip_pose(bend, ROD)
    np.testing.assert_allclose(positions[[0, 2]], [np.zeros(3), tip_m], atol=1e-4)
    np.testing.assert_allclose(turns[2], np.roll(tip_xyzw, 1), atol=1e-2)
    np.testing.assert_allclose(turns[0], [1.0, 0.0, 0.0, 0.0], atol=1e-2)


def test_fingers_bend_the_hand_rises_and_solids_are_where_they_are_said_to_be(monkeypatch):
    page = Page(monkeypatch)
    page.show("finger_markers", MarkerArray(markers=markers_of((0.0, 0.0))))
    waves = page.made["/hand/waves"]
    straight_m = waves.batched_positions.copy()
    page.show("finger_markers", MarkerArray(markers=markers_of((1.5, 0.0))))
    bent_m = waves.batched_positions
    assert waves.visible and bent_m.shape == (4 * WAVES, 3)
    assert (bent_m[WAVES - 1] - straight_m[WAVES - 1])[0] > 0.03  # toward +x, as bend_x says
    upright, found = (0.0, 0.0, 0.0, 1.0), colour((1, 1, 1), 0.9)
    palm = solid_marker(Time(), "world", "palm", 0, "box", (0.1, 0.1, 0.01), (0.0, 0.0, 0.105), upright, found)
    ball = solid_marker(Time(), "world", "object", 0, "sphere", (0.06,) * 3, (0.01, 0.0, -0.085), upright, found)
    page.show("plant/finger_markers", MarkerArray(markers=[palm, ball]))
    assert page.made["/hand"].position[2] == pytest.approx(0.1)
    assert page.made["/object_0"].position == (0.01, 0.0, -0.085)
    page.show("detections", MarkerArray(markers=[ball]))
    assert page.made["/hand/found_0"].visible
    page.show("detections", MarkerArray())
    assert not page.made["/hand/found_0"].visible


def test_a_chamber_under_pressure_is_lit_and_the_panel_says_how_it_stands(monkeypatch):
    page = Page(monkeypatch)
    values = np.zeros(16)
    values[5] = GRIPPER.pressure_limit_gauge_pa
    message: JointState = joint_state(Time(), CHANNEL_NAMES, effort=values)
    page.show("chamber_states", message)
    reds = page.made["/hand/chambers"].batched_colors[:, 0]
    assert reds[5] == 255 and (np.delete(reds, 5) < 100).all()
    page.viewer._tell()
    texts = [call.args[0] for call in page.server.gui.add_markdown.call_args_list]
    panel = page.server.gui.add_markdown.return_value.content
    assert len(texts) == 2 and "**error**, diverged" in panel


def test_buttons_ask_the_services_that_there_are_and_come_only_where_they_are_allowed():
    names = {f"{group}/{name}" for group, names in view.BUTTONS.items() for name in names}
    assert names | {view.AIR, view.STOP} <= {service.name for service in SERVICES}
    server, asked = MagicMock(), queue.SimpleQueue()
    view._add_buttons(server, asked)
    press = server.gui.add_button_group.return_value.on_click.call_args_list[0].args[0]
    press(SimpleNamespace(target=SimpleNamespace(value="auto")))
    assert asked.get_nowait() == ("grasp/auto", True)
