"""Scene files, the catalogue of objects, and what is refused."""

import dataclasses
import inspect
import re

import numpy as np
import pytest
import yaml

from mbpam_ros.configuration import ConfigError, config_path, load_yaml
from mbpam_ros.geometry.solids import half_height
from mbpam_ros.gripper import load_gripper
from mbpam_ros.plant.fidelity import Fidelity, FidelityRequest
from mbpam_ros.plant.planner import choose_fidelity
from mbpam_ros.plant.plant import build_plant
from mbpam_ros.plant.scene import PlacedObject, Scene, SupportConfig, load_objects, load_scene, scene_names


def changed(tmp_path, **values):
    content = load_yaml("scenes/bulb.yaml") | values
    path = tmp_path / "changed.yaml"
    path.write_text(yaml.safe_dump(content))
    return path


def test_there_is_a_scene_for_each_object_of_the_paper_and_an_empty_one():
    found = {scene.object and scene.object.name for scene, _ in map(load_scene, scene_names())}
    assert found == {"tomato", "bulb", "banana", "aluminium_tube", "carton", None}


def test_masses_are_the_papers():
    masses = {name: spec.mass_kg for name, spec in load_objects().items()}
    assert masses == {"tomato": 0.183, "bulb": 0.046, "banana": 0.180, "aluminium_tube": 0.118, "carton": 0.048}


@pytest.mark.parametrize("name", [name for name in scene_names() if name not in ("empty", "rig")])
def test_every_object_starts_on_its_support_70_to_100_mm_below_the_palm(name):
    scene, _ = load_scene(name)
    depth = scene.object_position_m[2]
    bottom = depth + half_height(scene.object.shape, scene.object.size_m, scene.object_orientation_xyzw)
    assert 0.070 <= depth <= 0.100
    assert bottom == pytest.approx(scene.support.depth_m, abs=1e-9)


def test_a_rod_lies_along_y_and_turns_with_the_yaw():
    scene, _ = load_scene("tube")
    for yaw in (0.0, 0.7):
        x, y, z, w = dataclasses.replace(scene, object_yaw_rad=yaw).object_orientation_xyzw
        axis = [2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)]
        np.testing.assert_allclose(axis, [-np.sin(yaw), np.cos(yaw), 0.0], atol=1e-12)


def test_an_unknown_scene_lists_the_known_ones():
    with pytest.raises(ConfigError, match="bulb, carton"):
        load_scene("piano")


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"object": "piano"}, "no object 'piano'"),
        ({"object": None}, "both be given or both be null"),
        ({"object": {"shape": "sphere"}}, "no object"),
        ({"speed": 1.0}, "unknown key speed; known: object, .*tier"),
        ({"name": "bulb"}, "unknown key name"),
        ({"sub_step_s": -0.001}, "sub_step_s must be greater than 0"),
        ({"sub_step_s": float("nan")}, "finite"),
        ({"support": {"depth_m": 0.1, "half_size_m": [0.01, 0.01]}}, "give both"),
        ({"friction_coefficient": -0.1}, "friction_coefficient"),
        ({"strains": ["stretch"]}, "bend, stretch, twist, bend always"),
        ({"strains": ["bend", "shear"]}, "bend, stretch, twist, bend always"),
        ({"gravity_direction": [0.0, 0.0, 0.0]}, "must point somewhere"),
    ],
)
def test_a_wrong_scene_file_is_refused_with_the_reason(tmp_path, values, message):
    with pytest.raises(ConfigError, match=message):
        load_scene(changed(tmp_path, **values))


def test_a_scene_says_which_strains_its_muscles_have_and_where_gravity_pulls(tmp_path):
    path = changed(tmp_path, tier="rod", strains=["bend", "stretch"], gravity_direction=[0.0, 3.0, 4.0])
    scene, request = load_scene(path)
    fidelity = choose_fidelity(scene, request, load_gripper().geometry.length_m)
    assert (fidelity.twist_modes, fidelity.stretch_modes) == (0, 2)
    np.testing.assert_allclose(scene.gravity_direction, [0.0, 0.6, 0.8])
    scene, request = load_scene("bulb")
    fidelity = choose_fidelity(scene, request, load_gripper().geometry.length_m)
    assert (fidelity.twist_modes, fidelity.stretch_modes) == (0, 0)
    assert scene.gravity_direction == (0.0, 0.0, 1.0)


def test_an_object_inside_its_support_is_refused_with_the_depth_that_would_do(tmp_path):
    scene = load_scene(changed(tmp_path, support={"depth_m": 0.1, "half_size_m": [0.01, 0.01], "stand_height_m": 0.2}))
    with pytest.raises(ConfigError, match=r"15\.0 mm inside its support.*0\.1150"):
        build_plant(*scene, load_gripper())


def test_an_object_inside_the_palm_is_refused_with_the_depth_that_would_do(tmp_path):
    scene = load_scene(changed(tmp_path, object_position_m=[0.0, 0.0, 0.010], support=None))
    with pytest.raises(ConfigError, match=r"20\.0 mm inside the palm.*0\.0300"):
        build_plant(*scene, load_gripper())


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"object_position_m": [0.010, 0.012, 0.085]}, r"5\.5 mm inside finger 1"),
        ({"object_position_m": [-0.020, 0.035, 0.145]}, r"10\.7 mm inside finger 2"),  # at its rounded tip
        ({"object": "aluminium_tube", "object_yaw_rad": 0.8}, r"19\.3 mm inside finger [24].*object_yaw_rad"),
        ({"object": "carton", "object_position_m": [0.020, 0.0, 0.085]}, r"12\.1 mm inside finger [14]"),
    ],
)
def test_an_object_inside_a_straight_finger_is_refused(tmp_path, values, message):
    with pytest.raises(ConfigError, match=message):
        build_plant(*load_scene(changed(tmp_path, support=None, **values)), load_gripper())


def test_a_table_that_the_hanging_muscles_would_pierce_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="deeper table"):
        build_plant(*load_scene(changed(tmp_path, support={"depth_m": 0.115})), load_gripper())


def test_a_table_is_one_endless_plane_and_a_stand_a_plate_on_one():
    np.testing.assert_array_equal(SupportConfig(0.2).planes_m, [[0.2, np.inf, np.inf]])
    np.testing.assert_allclose(
        SupportConfig(0.1, (0.01, 0.03), 0.2).planes_m, [[0.1, 0.01, 0.03], [0.3, np.inf, np.inf]]
    )


def with_objects(tmp_path, *objects, **values):
    content = load_yaml("scenes/bulb.yaml") | values
    for key in ("object", "object_position_m", "object_yaw_rad"):
        del content[key]
    path = tmp_path / "several.yaml"
    path.write_text(yaml.safe_dump(content | {"objects": list(objects)}))
    return path


BULB = {"object": "bulb", "object_position_m": [0.0, 0.0, 0.085]}
FAR = {"object": "carton", "object_position_m": [0.15, 0.0, 0.285], "object_yaw_rad": 0.4}


def test_a_scene_lists_several_objects_the_one_to_grasp_first(tmp_path):
    second = {**BULB, "name": "second bulb", "object_position_m": [-0.15, 0.0, 0.285]}
    scene, request = load_scene(with_objects(tmp_path, BULB, FAR, second))
    assert [each.object.name for each in scene.placed] == ["bulb", "carton", "second bulb"]
    assert (scene.object.name, scene.object_position_m) == ("bulb", (0.0, 0.0, 0.085))
    assert scene.others[0].object_yaw_rad == 0.4
    seen = build_plant(scene, request, load_gripper()).observe()
    assert [each.name for each in seen.objects] == ["bulb", "carton", "second bulb"]
    np.testing.assert_array_equal(seen.objects[2].in_world.position_m, [-0.15, 0.0, 0.285])
    np.testing.assert_array_equal(seen.object_in_world.position_m, seen.objects[0].in_world.position_m)


@pytest.mark.parametrize(
    ("objects", "message"),
    [
        ([BULB], "two objects are named bulb; give each a name"),
        (
            [{**BULB, "name": "top", "object_position_m": [0.0, 0.0, 0.035]}],
            "bulb and top start 10.0 mm inside each other",
        ),
        ([{**FAR, "object_position_m": [0.15, 0.0, 0.295]}], r"carton starts 10\.0 mm inside its support.*0\.2850"),
        ([{**FAR, "object_position_m": [0.02, 0.0, 0.095]}], r"carton starts 10\.0 mm inside its support.*0\.0850"),
        ([{**FAR, "object_position_m": [0.15, 0.0, 0.010]}], r"carton starts 20\.0 mm inside the palm"),
        ([{**FAR, "object_position_m": [0.05, 0.035, 0.1]}], r"carton starts .* mm inside finger"),
        ([{**FAR, "colour": "red"}], r"objects\[1\]: unknown key colour"),
        ([{"object": "piano", "object_position_m": [0.15, 0.0, 0.2]}], "no object 'piano'"),
        (["carton"], r"objects\[1\]: expected keys object"),
        (
            [{**FAR, "name": f"box {k}", "object_position_m": [0.3 * k, 1.0, 0.2]} for k in range(32)],
            "33 objects; at most",
        ),
    ],
)
def test_further_objects_that_cannot_be_are_refused_with_the_reason(tmp_path, objects, message):
    with pytest.raises(ConfigError, match=message):
        build_plant(*load_scene(with_objects(tmp_path, BULB, *objects)), load_gripper())


def test_an_empty_list_of_objects_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="expected a list with an entry for each object"):
        load_scene(with_objects(tmp_path))


def test_one_object_and_a_list_of_objects_are_not_given_together(tmp_path):
    with pytest.raises(ConfigError, match="object, object_position_m, object_yaw_rad and objects"):
        load_scene(changed(tmp_path, objects=[BULB]))


def test_every_field_of_a_scene_is_explained():
    for kind in (PlacedObject, Scene, FidelityRequest, Fidelity):
        told = re.findall(r"^    ([a-z_0-9, ]+):", inspect.getdoc(kind), re.MULTILINE)
        assert ", ".join(told).split(", ") == [field.name for field in dataclasses.fields(kind)]


def test_the_catalogue_says_what_is_the_papers_and_what_is_assumed():
    text = config_path("objects.yaml").read_text()
    assert "Masses: paper" in text
    assert "assumptions" in text
