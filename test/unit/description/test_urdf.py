"""The URDF: a chain that follows the arc of its bend, read by another parser; the mesh of a wave; the frames."""

import math
import shutil
from collections import Counter
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from mbpam_ros.actuator.chambers import BEND_NAMES
from mbpam_ros.actuator.drawing import load_drawing
from mbpam_ros.actuator.kinematics import tip_pose
from mbpam_ros.commands.mbpam import main
from mbpam_ros.configuration import config_directory, load_yaml
from mbpam_ros.description.frames import Frames, orientation_of, turned_up, up
from mbpam_ros.description.urdf import gripper_urdf, joint_count
from mbpam_ros.description.wave_mesh import Wave, WaveError, wave_triangles
from mbpam_ros.geometry.stl import binary_stl
from mbpam_ros.gripper import load_gripper
from mbpam_ros.vision.camera import camera_pose, load_camera_config

GRIPPER = load_gripper()
JOINTS = joint_count(GRIPPER)
CAMERA = camera_pose(load_camera_config())
WAVE = Wave(0.010, 0.0025, 0.002, 0.0023, 0.007)


def urdf(prefix=""):
    return gripper_urdf(GRIPPER, CAMERA.rotation, CAMERA.position_m, Frames(prefix))


def pose_of(robot, link, positions):
    """Rotation and place of a link in the root for joint positions by name, as any reader of URDF finds them."""
    joints = {joint.find("child").get("link"): joint for joint in robot.iter("joint")}
    rotation, place = Rotation.identity(), np.zeros(3)
    while link in joints:
        joint = joints[link]
        origin = joint.find("origin")
        turn = Rotation.from_euler("xyz", [float(each) for each in origin.get("rpy").split()])
        if joint.get("type") == "revolute":
            mimic = joint.find("mimic")
            angle = positions[joint.get("name")] if mimic is None else positions[mimic.get("joint")]
            angle *= 1.0 if mimic is None else float(mimic.get("multiplier"))
            axis = np.array([float(each) for each in joint.find("axis").get("xyz").split()])
            turn *= Rotation.from_rotvec(angle * axis)
        rotation, place = turn * rotation, turn.apply(place) + [float(each) for each in origin.get("xyz").split()]
        link = joint.find("parent").get("link")
    return rotation, place


@pytest.mark.parametrize("bend", [(0.0, 0.0), (0.5, 0.0), (0.0, -1.5), (1.8, 1.8), (-2.6, 0.4)])
def test_a_chain_ends_where_the_arc_of_its_bend_does(bend):
    robot = ElementTree.fromstring(urdf())
    positions = dict.fromkeys(BEND_NAMES, 0.0) | {"finger_2_bend_x": bend[0], "finger_2_bend_y": bend[1]}
    rotation, place = pose_of(robot, "finger_2_end", positions)
    rod = GRIPPER.rod_geometry
    end_m = rod.end_length_m + 0.5 * rod.active_length_m / JOINTS
    tip_m, orientation = tip_pose(bend, rod)
    angle = math.hypot(*bend)
    off_m = place + rotation.apply([0.0, 0.0, end_m]) - GRIPPER.finger_base_m[1] - tip_m
    # Of the straight pieces, and of the order of the two turns, each to second order in a piece's bend.
    assert np.linalg.norm(off_m) <= rod.active_length_m * (angle / JOINTS) ** 2 / 8.0 + 1e-9
    assert (rotation.inv() * Rotation.from_quat(orientation)).magnitude() <= 0.3 * (angle / JOINTS) ** 2 + 1e-7


def test_another_parser_reads_it_and_finds_the_joints_of_joint_states():
    parser = pytest.importorskip("urdf_parser_py.urdf")
    robot = parser.URDF.from_xml_string(urdf("right/").encode())
    assert robot.get_root() == "right/gripper_base"
    driven = [joint.name for joint in robot.joints if joint.type == "revolute" and joint.mimic is None]
    assert sorted(driven) == sorted(BEND_NAMES)
    assert {joint.mimic.joint for joint in robot.joints if joint.mimic is not None} == set(BEND_NAMES)
    assert robot.get_chain("right/gripper_base", "right/finger_4_end", joints=False)[1] == "right/finger_4_mount"


def test_two_grippers_share_no_link_and_the_camera_looks_as_its_file_says():
    links = [{link.get("name") for link in ElementTree.fromstring(urdf(prefix)).iter("link")} for prefix in ("", "b/")]
    assert not links[0] & links[1] and len(links[0]) == len(links[1])
    rotation, place = pose_of(ElementTree.fromstring(urdf()), "camera_optical", {})
    np.testing.assert_allclose(rotation.as_matrix(), CAMERA.rotation, atol=1e-8)
    np.testing.assert_allclose(place, CAMERA.position_m, atol=1e-8)


def test_a_wave_is_a_closed_surface_around_its_silicone():
    triangles = wave_triangles(WAVE)
    edges = Counter()
    for corners in triangles.round(12) + 0.0:
        edges.update((tuple(corners[i]), tuple(corners[i - 2])) for i in range(3))
    assert set(edges.values()) == {1} and all((end, start) in edges for start, end in edges)
    volume_m3 = np.linalg.det(triangles).sum() / 6.0
    z = np.linspace(-0.5, 0.5, 2001) * WAVE.length_m
    outer = WAVE.crest_radius_m - 0.5 * WAVE.amplitude_m * (1.0 - np.cos(2.0 * np.pi * z / WAVE.length_m))
    inner, half = outer - WAVE.wall_m, 0.5 * WAVE.cross_m
    first = np.arcsin(half / inner)
    chamber = inner**2 * (0.25 * np.pi - first) - half * (inner * np.cos(first) - half)
    assert volume_m3 == pytest.approx(np.trapezoid(np.pi * outer**2 - 4.0 * chamber, z), rel=0.01)
    assert len(binary_stl(triangles)) == 84 + 50 * len(triangles)
    with pytest.raises(WaveError, match="no chamber is left in the valleys"):
        Wave(0.010, 0.0025, 0.002, 0.0062, 0.007)


def test_up_in_the_world_is_up_and_turns_are_turned_with_it():
    turn = Rotation.random(rng=np.random.default_rng(1))
    assert up(np.array([1.0, 2.0, 3.0])).tolist() == [1.0, -2.0, -3.0]
    arm = np.array([0.1, 0.2, 0.3])
    turned = Rotation.from_quat(turned_up(turn.as_quat()))
    np.testing.assert_allclose(turned.apply(arm), up(turn.apply(arm)), atol=1e-12)
    for each in (turn, Rotation.identity(), *(Rotation.from_euler(axis, 180, degrees=True) for axis in "xyz")):
        assert (Rotation.from_quat(orientation_of(each.as_matrix())) * each.inv()).magnitude() < 1e-7


def test_the_verb_writes_urdf_and_mesh_that_belong_together(tmp_path, capsys):
    assert main(["urdf"]) == 0
    assert capsys.readouterr().out == urdf()
    assert main(["urdf", "--out", str(tmp_path / "g.urdf"), "--meshes", str(tmp_path / "meshes")]) == 0
    (address,) = {mesh.get("filename") for mesh in ElementTree.parse(tmp_path / "g.urdf").iter("mesh")}
    assert address == (tmp_path / "meshes" / "wave.stl").as_uri() and (tmp_path / "meshes" / "wave.stl").exists()


def test_the_muscle_of_the_drawing_is_drawn(tmp_path, monkeypatch):
    """With its wall and its waves; one that its gripper file draws itself has the paper's."""
    shutil.copytree(config_directory(), tmp_path / "config")
    monkeypatch.setenv("MBPAM_CONFIG_DIR", str(tmp_path / "config"))
    drawing = load_yaml("muscles/paper.yaml") | {"c_mm": 1.7, "wave_count": 9.0}
    (tmp_path / "config" / "muscles" / "thin.yaml").write_text(yaml.safe_dump(drawing))
    content = {name: value for name, value in load_yaml("gripper.yaml").items() if name not in ("design", "geometry")}
    (tmp_path / "config" / "thin.yaml").write_text(yaml.safe_dump(content | {"muscle": "thin", "target": "fe"}))
    thin = load_gripper("thin.yaml")
    robot = ElementTree.fromstring(gripper_urdf(thin, CAMERA.rotation, CAMERA.position_m))
    turning = [joint for joint in robot.iter("joint") if joint.find("mimic") is not None]
    assert len(turning) == 4 * 2 * 10 and joint_count(GRIPPER) == 15
    assert Wave.of_gripper(thin, 0.01).wall_m == pytest.approx(0.0017)
    assert Wave.of_gripper(GRIPPER, 0.007).wall_m == pytest.approx(1e-3 * load_drawing("paper").c_mm)
