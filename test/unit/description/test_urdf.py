"""The URDF: a chain that follows the arc of its bend, read by another parser; a muscle's pieces as meshes; frames."""

import dataclasses
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
from mbpam_ros.description.urdf import gripper_urdf, joint_count, muscle_meshes
from mbpam_ros.description.wave_mesh import Wave, WaveError, end_triangles, wave_triangles
from mbpam_ros.geometry.stl import binary_stl
from mbpam_ros.gripper import load_gripper
from mbpam_ros.vision.camera import camera_pose, load_camera_config

GRIPPER = load_gripper()
JOINTS = joint_count(GRIPPER)
CAMERA = camera_pose(load_camera_config())


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


def is_closed(triangles):
    """Whether every edge lies in two triangles, once in each direction."""
    edges = Counter()
    for corners in triangles.round(12) + 0.0:
        edges.update((tuple(corners[i]), tuple(corners[i - 2])) for i in range(3))
    return set(edges.values()) == {1} and all((end, start) in edges for start, end in edges)


def volume_of(triangles):
    return np.linalg.det(triangles).sum() / 6.0


def drawn_wave(drawing):
    lengths_mm = (drawing.outer_radius_mm, drawing.a_mm, drawing.b_mm, drawing.c_mm)
    return Wave(*(1e-3 * length for length in lengths_mm), 1e-3 * drawing.active_length_mm / drawing.wave_count)


@pytest.mark.parametrize(("a_mm", "b_mm", "c_mm"), [(2.5, 2.0, 2.3), (1.5, 1.0, 1.5), (3.5, 3.0, 2.5)])
def test_the_pieces_of_a_muscle_are_closed_and_together_as_large_as_its_drawing(a_mm, b_mm, c_mm):
    drawing = dataclasses.replace(load_drawing("paper"), a_mm=a_mm, b_mm=b_mm, c_mm=c_mm)
    wave = drawn_wave(drawing)
    pieces = wave_triangles(wave), end_triangles(wave, 1e-3 * drawing.end_length_mm)
    assert all(is_closed(triangles) for triangles in pieces)
    ends_mm3 = 2.0 * drawing.end_length_mm * math.pi * drawing.outer_radius_mm**2
    drawn_m3 = 1e-9 * (drawing.section_mm2 * drawing.active_length_mm + ends_mm3)
    one, end = (volume_of(triangles) for triangles in pieces)
    assert (drawing.wave_count - 1) * one + 2.0 * end == pytest.approx(drawn_m3, rel=0.01)
    assert one == pytest.approx(1e-6 * drawing.section_mm2 * wave.length_m, rel=0.01)
    assert len(binary_stl(pieces[0])) == 84 + 50 * len(pieces[0])


def test_the_meshes_of_a_straight_finger_lie_end_to_end():
    meshes = muscle_meshes(GRIPPER)
    robot = ElementTree.fromstring(gripper_urdf(GRIPPER, CAMERA.rotation, CAMERA.position_m, meshes="file:///m"))
    ranges = []
    for link in robot.iter("link"):
        for visual in link.iter("visual"):
            if link.get("name").startswith("finger_3") and (mesh := visual.find("geometry/mesh")) is not None:
                rotation, place = pose_of(robot, link.get("name"), dict.fromkeys(BEND_NAMES, 0.0))
                origin = visual.find("origin")
                turn = rotation * Rotation.from_euler("xyz", [float(each) for each in origin.get("rpy").split()])
                place = place + rotation.apply([float(each) for each in origin.get("xyz").split()])
                points = turn.apply(meshes[mesh.get("filename").removeprefix("file:///m/")].reshape(-1, 3)) + place
                ranges.append((points[:, 2].min(), points[:, 2].max()))
    low, high = np.array(sorted(ranges)).T
    np.testing.assert_allclose([low[0], high[-1]], [0.0, GRIPPER.rod_geometry.length_m], atol=1e-8)
    np.testing.assert_allclose(low[1:], high[:-1], atol=1e-8)


def test_a_wave_without_chambers_is_refused():
    with pytest.raises(WaveError, match="no chamber is left in the valleys"):
        Wave(0.010, 0.0025, 0.002, 0.0062, 0.007)


def test_the_pieces_of_a_muscle_cover_the_solid_that_its_moulds_cast():
    pytest.importorskip("manifold3d")
    from mbpam_ros.study.muscle.solids import muscle_solid

    drawing = load_drawing("paper")
    wave, solid_m = drawn_wave(drawing), 1e-3 * drawing.end_length_mm
    end = end_triangles(wave, solid_m)
    tip = end * [1.0, -1.0, -1.0] + [0.0, 0.0, 2.0 * solid_m + 1e-3 * drawing.active_length_mm]
    waves = [
        wave_triangles(wave) + [0.0, 0.0, solid_m + number * wave.length_m]
        for number in range(1, round(drawing.wave_count))
    ]
    cast = muscle_solid(drawing)
    for piece in (end, *waves, tip):
        low, high = 1e3 * piece[..., 2].min(), 1e3 * piece[..., 2].max()
        slab = cast.trim_by_plane((0.0, 0.0, 1.0), low).trim_by_plane((0.0, 0.0, -1.0), -high)
        assert 1e9 * volume_of(piece) == pytest.approx(slab.volume(), rel=0.01)
        corners = slab.to_mesh().vert_properties[:, :3]
        for z_mm in (low, high):  # the solid's own corners there: on the arms' and walls' circle, none beyond it
            drawn = 1e3 * np.linalg.norm(piece[np.abs(1e3 * piece[..., 2] - z_mm) < 1e-6][:, :2], axis=1).max()
            at_cut = np.linalg.norm(corners[np.abs(corners[:, 2] - z_mm) < 1e-3][:, :2], axis=1).max()
            assert drawn == pytest.approx(at_cut, abs=0.02)
    assert 1e3 * max(np.linalg.norm(piece[..., :2], axis=-1).max() for piece in waves) == pytest.approx(
        drawing.outer_radius_mm
    )


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
    text = (tmp_path / "g.urdf").read_text()
    drawn = [mesh.get("filename") for mesh in ElementTree.fromstring(text).iter("mesh")]
    files = {(tmp_path / "meshes" / name).as_uri(): (tmp_path / "meshes" / name) for name in ("wave.stl", "end.stl")}
    assert set(drawn) == set(files) and all(file.stat().st_size > 84 for file in files.values())
    assert Counter(drawn) == dict(zip(files, (4 * (JOINTS - 1), 4 * 2), strict=True))


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
    assert len(turning) == 4 * 2 * 9 and joint_count(GRIPPER) == 14
    assert Wave.of_gripper(thin, 0.01).wall_m == pytest.approx(0.0017)
    assert Wave.of_gripper(GRIPPER, 0.007).wall_m == pytest.approx(1e-3 * load_drawing("paper").c_mm)
