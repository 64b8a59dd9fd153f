"""Configuration that cannot hurt: whatever stands in a file, it is read, or refused in one line that names the file."""

import copy
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mbpam_ros import bounded_yaml
from mbpam_ros.actuator.drawing import MuscleDrawing
from mbpam_ros.actuator.named_designs import load_design
from mbpam_ros.configuration import LARGEST_NUMBER, ConfigError, config_directory, load_config, load_yaml
from mbpam_ros.estimation.estimator import EstimatorConfig
from mbpam_ros.grasp.arbitration import load_grasp_config
from mbpam_ros.grasp.modes import load_modes
from mbpam_ros.gripper import load_gripper
from mbpam_ros.plant.scene import load_objects, load_scene
from mbpam_ros.plant.tiers.base import PlantConfig
from mbpam_ros.pneumatics.config import load_pneumatics
from mbpam_ros.study.silicone.known import load_silicones
from mbpam_ros.vision.camera import Camera, load_camera_config
from mbpam_ros.vision.detector import load_detector_config
from mbpam_ros.vision.image_file import read_camera_info

pytestmark = pytest.mark.slow

LOADERS = {
    "camera.yaml": lambda path: Camera.from_config(load_camera_config(path)),
    "detector.yaml": load_detector_config,
    "estimator.yaml": lambda path: load_config(EstimatorConfig, path),
    "grasp.yaml": load_grasp_config,
    "gripper.yaml": load_gripper,
    "modes.yaml": load_modes,
    "muscles/paper.yaml": lambda path: load_config(MuscleDrawing, path),
    "objects.yaml": load_objects,
    "rig_camera.yaml": lambda path: Camera.from_config(load_camera_config(path)),
    "plant.yaml": lambda path: load_config(PlantConfig, path),
    "pneumatics.yaml": load_pneumatics,
    "scenes/bulb.yaml": load_scene,
    "scenes/rig.yaml": load_scene,
    "silicones.yaml": load_silicones,
}
NO_LOADER = {"nodes.yaml"}  # ROS reads it

BILLION = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{name}: &{name} [{', '.join([f'*{before}'] * 9)}]\n" for before, name in zip("abcdefgh", "bcdefghi", strict=True)
)
MERGES = "a: &a {x: 1}\n" + "".join(
    f"{name}: &{name} {{<<: [{', '.join([f'*{before}'] * 9)}]}}\n"
    for before, name in zip("abcdefgh", "bcdefghi", strict=True)
)
HOSTILE = {
    "500 nested brackets": ("a: " + "[" * 500 + "]" * 500, "line 1: nested more than 20 deep"),
    "a million open brackets": ("[" * 999_999, "line 1: nested more than 20 deep"),
    "an integer of 5000 digits": (f"a: 1\nb: {'9' * 5000}\n", "line 2: b: a number in it cannot be read"),
    "the same in a list": (f"a: [1, {'9' * 5000}]\n", "line 1: a: a number in it cannot be read"),
    "the same as a key": (f"? {'9' * 5000}\n: 1\n", "a number in it cannot be read"),
    "the same alone": ("9" * 5000, "a number in it cannot be read"),
    "sixty to the power of a thousand": (f"a: 1{':59' * 1000}.5\n", "a: a number in it cannot be read"),
    "30 000 keys": ("".join(f"key_{i}: 1\n" for i in range(30_000)), "more than 10000 values"),
    "aliases of aliases": (BILLION, "more than 10000 values, those of aliases counted"),
    "merges of merges": (MERGES, "more than 10000 values, those of aliases counted"),
    "a list that holds itself": ("a: &a [*a]", "alias *a stands within or before what it stands for"),
    "more than a megabyte": ("#" * 1_000_001, "1000001 characters, at most 1000000 are read"),
    "a tag": ("a: !!python/object/apply:os.system [ls]", "tags are not read"),
    "an empty number": ('a: !!int ""', "tags are not read"),
    "a mapping for a key": ("{a: 1}: 2", "a key is a list or a mapping"),
    "a key twice": ("a: 1\nb: 2\na: 3\n", "line 3: key a stands twice"),
    "two documents": ("a: 1\n---\nb: 2\n", "line 2: not valid YAML: but found another document"),
    "a bracket too few": ("a: [1, 2\nb: 3\n", "line 2: not valid YAML"),
    "a bell": ("a: \x07\n", "not valid YAML: unacceptable character"),
    "a list": ("[1, 2]", "expected a mapping at the top, found list"),
    "nothing": ("", "expected a mapping at the top, found NoneType"),
}


def refusal(path, load=load_yaml):
    with pytest.raises(ConfigError) as refused:
        load(path)
    message = str(refused.value)
    assert "\n" not in message and len(message) < 400
    return message


@pytest.mark.parametrize("case", HOSTILE)
def test_a_hostile_file_is_refused_in_one_line_with_its_place(tmp_path, case):
    text, expected = HOSTILE[case]
    path = tmp_path / "some.yaml"
    path.write_text(text)
    message = refusal(path)
    assert message.startswith(f"{path}: ") and expected in message


def test_bytes_that_are_no_text_are_refused(tmp_path):
    path = tmp_path / "some.yaml"
    path.write_bytes(b"a: \xff\xfe")
    assert refusal(path) == f"{path}: not valid YAML: not text in UTF-8"


def test_aliases_and_merges_of_a_sensible_size_are_read():
    text = "a: &a {x: 1, y: 2}\nb: {<<: *a, y: 3}\nc: [*a, *a]\n"
    assert bounded_yaml.parse(text) == {"a": {"x": 1, "y": 2}, "b": {"x": 1, "y": 3}, "c": [{"x": 1, "y": 2}] * 2}


def test_a_date_is_text():
    assert bounded_yaml.parse("a: 2026-13-45\nb: 2026-01-02\n") == {"a": "2026-13-45", "b": "2026-01-02"}


@pytest.mark.parametrize("value", ["1.0e+308", "-1.0e+308", "1" + "0" * 300, ".inf", ".nan"])
def test_a_camera_at_the_end_of_the_universe_is_refused_by_key(tmp_path, value):
    path = tmp_path / "camera.yaml"
    shipped = (config_directory() / "camera.yaml").read_text()
    path.write_text(shipped.replace("position_m: [0.027", f"position_m: [{value}"))
    assert "position_m[0]: expected a" in refusal(path, load_camera_config)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [("[0.027,", "[100.0,", "within 10 m"), ("width_px: 800", "width_px: 900000", "at most 16384 pixels")],
)
def test_a_camera_that_cannot_be_is_refused(tmp_path, old, new, expected):
    path = tmp_path / "camera.yaml"
    path.write_text((config_directory() / "camera.yaml").read_text().replace(old, new))
    assert expected in refusal(path, load_camera_config)


def test_every_shipped_file_is_tried_here():
    root = config_directory()
    shipped = {path.name for path in root.glob("*.yaml")} | {
        "scenes/bulb.yaml",
        "scenes/rig.yaml",
        "muscles/paper.yaml",
    }
    assert shipped == set(LOADERS) | NO_LOADER


def places(content, place=()):
    """Return the places of all values, those within others too."""
    pairs = content.items() if isinstance(content, dict) else enumerate(content) if isinstance(content, list) else ()
    return [place] * bool(place) + [found for key, value in pairs for found in places(value, (*place, key))]


def written(value):
    """Return a value as YAML in one line."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {written(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(written, value)) + "]"
    return {True: "true", False: "false", None: "null"}.get(value) if isinstance(value, bool | None) else f"{value}"


VALUES = st.one_of(
    st.none(),
    st.booleans(),
    st.sampled_from([0, -1, 10**400, 1e308, -1e308, 5e-324, LARGEST_NUMBER, -LARGEST_NUMBER, 1e-12]),
    st.integers(),
    st.floats().map(lambda x: ".nan" if x != x else ".inf" if x == float("inf") else "-.inf" if x < -1e308 else x),
    st.text("abcxyz_-./ ", max_size=8).map(lambda text: f'"{text}"'),
    st.lists(st.floats(-1e3, 1e3), max_size=4),
    st.just({}),
    st.just({"a": [1, {"b": 2}]}),
)


def accepts_or_refuses(path, load):
    try:
        load(path)
    except ConfigError as error:
        assert "\n" not in str(error) and len(str(error)) < 800


@pytest.mark.parametrize("name", LOADERS)
@given(data=st.data())
@settings(max_examples=25, deadline=None)
def test_any_value_in_a_shipped_file_is_accepted_or_refused_in_one_line(tmp_path_factory, name, data):
    content = copy.deepcopy(load_yaml(name))
    *above, last = data.draw(st.sampled_from(places(content)))
    inner = content
    for key in above:
        inner = inner[key]
    inner[last] = data.draw(VALUES)
    path = tmp_path_factory.getbasetemp() / "value.yaml"
    path.write_text(written(content))
    accepts_or_refuses(path, LOADERS[name])


@pytest.mark.parametrize("name", LOADERS)
@given(data=st.data())
@settings(max_examples=25, deadline=None)
def test_any_change_of_the_text_is_accepted_or_refused_in_one_line(tmp_path_factory, name, data):
    text = (config_directory() / name).read_text()
    start = data.draw(st.integers(0, len(text)))
    end = data.draw(st.integers(start, min(start + 20, len(text))))
    inserted = data.draw(st.text(st.sampled_from("[]{}:,&*!|>%@`\"'#-?<= \n\t0123456789.eax\x00\u2028"), max_size=8))
    path = tmp_path_factory.getbasetemp() / "text.yaml"
    path.write_text(text[:start] + inserted + text[end:])
    accepts_or_refuses(path, LOADERS[name])


@given(data=st.binary(max_size=200))
@settings(max_examples=100, deadline=None)
def test_any_bytes_are_refused_as_camera_info_and_as_a_design(tmp_path_factory, data):
    path: Path = tmp_path_factory.getbasetemp() / "bytes.yaml"
    path.write_bytes(data)
    refusal(path, read_camera_info)
    refusal(str(path), load_design)
