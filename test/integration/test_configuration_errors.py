"""A configuration that cannot be used is refused when a node is built, with the place and what is wrong there."""

import pytest
import yaml

from mbpam_ros.configuration import ConfigError, load_yaml
from mbpam_ros.nodes.grasp_arbiter import GraspArbiterNode
from mbpam_ros.nodes.object_detector import ObjectDetectorNode
from mbpam_ros.nodes.plant import PlantNode
from mbpam_ros.nodes.pressure_sensor import PressureSensorNode
from mbpam_ros.nodes.state_estimator import StateEstimatorNode
from mbpam_ros.nodes.valve_controller import ValveControllerNode

FILES = [
    (PlantNode, "gripper", "gripper.yaml"),
    (PlantNode, "pneumatics", "pneumatics.yaml"),
    (PlantNode, "camera", "camera.yaml"),
    (PlantNode, "scene", "scenes/bulb.yaml"),
    (PressureSensorNode, "pneumatics", "pneumatics.yaml"),
    (ValveControllerNode, "gripper", "gripper.yaml"),
    (ValveControllerNode, "pneumatics", "pneumatics.yaml"),
    (StateEstimatorNode, "gripper", "gripper.yaml"),
    (StateEstimatorNode, "estimator", "estimator.yaml"),
    (ObjectDetectorNode, "gripper", "gripper.yaml"),
    (ObjectDetectorNode, "camera", "camera.yaml"),
    (ObjectDetectorNode, "detector", "detector.yaml"),
    (GraspArbiterNode, "gripper", "gripper.yaml"),
    (GraspArbiterNode, "modes", "modes.yaml"),
    (GraspArbiterNode, "grasp", "grasp.yaml"),
]
each_file_of_each_node = pytest.mark.parametrize(
    "node_class, parameter, file", FILES, ids=[f"{node.__name__}-{parameter}" for node, parameter, _ in FILES]
)
OF_GRIPPER = (PlantNode, ValveControllerNode, StateEstimatorNode, ObjectDetectorNode, GraspArbiterNode)


@pytest.fixture
def refused(graph, tmp_path):
    """Builds a node on a file with these contents and returns the complaint."""

    def build(node_class, parameter, contents, **others):
        path = tmp_path / "edited.yaml"
        path.write_text(contents if isinstance(contents, str) else yaml.safe_dump(contents), encoding="utf-8")
        with pytest.raises(ConfigError) as caught:
            graph.add(node_class, **{parameter: str(path)}, **others)
        return str(caught.value)

    return build


def changed(file, path, value):
    """The mapping of a configuration file with the value at ``a.b.c`` changed."""
    mapping = load_yaml(file)
    *parents, key = path.split(".")
    target = mapping
    for parent in parents:
        target = target[parent]
    target[key] = value
    return mapping


@each_file_of_each_node
def test_an_unknown_key_is_named_with_the_known_ones(refused, node_class, parameter, file):
    complaint = refused(node_class, parameter, {**load_yaml(file), "colour_of_the_box": "blue"})
    assert "edited.yaml: unknown key colour_of_the_box; known: " in complaint


@each_file_of_each_node
def test_a_missing_key_is_named(refused, node_class, parameter, file):
    mapping = load_yaml(file)
    key = next(iter(mapping))
    del mapping[key]
    assert f"edited.yaml: missing key {key}" in refused(node_class, parameter, mapping)


@each_file_of_each_node
def test_a_missing_file_is_named(graph, node_class, parameter, file):
    with pytest.raises(ConfigError, match="nowhere.yaml: no such file"):
        graph.add(node_class, **{parameter: "nowhere.yaml"})


@each_file_of_each_node
@pytest.mark.parametrize("contents", ["a: [1, 2", "- a list", ""], ids=["not YAML", "a list", "empty"])
def test_a_file_that_holds_no_mapping_is_refused(refused, node_class, parameter, file, contents):
    complaint = refused(node_class, parameter, contents)
    assert "edited.yaml" in complaint
    assert "YAML" in complaint or "mapping" in complaint


@pytest.mark.parametrize("node_class", OF_GRIPPER)
@pytest.mark.parametrize("a_mm, b_mm", [(1.4, 2.0), (3.6, 2.0), (2.5, 0.9), (2.5, 3.1)])
def test_a_design_outside_the_sampled_domain_is_refused_with_the_domain_and_the_nearest_inside(
    refused, node_class, a_mm, b_mm
):
    complaint = refused(node_class, "gripper", changed("gripper.yaml", "design", {"a_mm": a_mm, "b_mm": b_mm}))
    assert f"a = {a_mm:g} mm, b = {b_mm:g} mm" in complaint
    assert "1.5 <= a <= 3.5 mm, 1 <= b <= 3 mm" in complaint
    assert "nearest design inside" in complaint


@pytest.mark.parametrize("node_class", OF_GRIPPER)
def test_a_design_that_no_one_named_is_refused_with_those_that_there_are(refused, node_class):
    complaint = refused(node_class, "gripper", changed("gripper.yaml", "design", "best"))
    assert "edited.yaml: design: no design 'best'; known: initial, optimised" in complaint


@pytest.mark.parametrize(
    "node_class, parameter, file, path, value",
    [
        (PlantNode, "gripper", "gripper.yaml", "geometry.outer_radius_m", -0.01),
        (PlantNode, "gripper", "gripper.yaml", "geometry.active_length_m", 0.0),
        (PlantNode, "gripper", "gripper.yaml", "geometry.active_length_m", 10**400),
        (PlantNode, "gripper", "gripper.yaml", "geometry.mass_per_length_kg_m", float("nan")),
        (PlantNode, "gripper", "gripper.yaml", "finger_circle_radius_m", 0.010),
        (PlantNode, "pneumatics", "pneumatics.yaml", "model", "steam"),
        (PlantNode, "pneumatics", "pneumatics.yaml", "chamber.lag_time_constant_s", -0.25),
        (PlantNode, "pneumatics", "pneumatics.yaml", "transducer.noise_v", -0.002),
        (PlantNode, "pneumatics", "pneumatics.yaml", "transducer.adc_bits", 12.5),
        (PlantNode, "camera", "camera.yaml", "width_px", -640),
        (PlantNode, "camera", "camera.yaml", "position_m", [0.0, 0.0]),
        (PlantNode, "scene", "scenes/bulb.yaml", "object", "unicorn"),
        (PlantNode, "scene", "scenes/bulb.yaml", "sub_step_s", -0.002),
        (PlantNode, "scene", "scenes/bulb.yaml", "pneumatics", "steam"),
        (PlantNode, "scene", "scenes/bulb.yaml", "support.depth_m", -0.115),
        (PlantNode, "scene", "scenes/bulb.yaml", "support.depth_m", 0.100),
        (PlantNode, "scene", "scenes/bulb.yaml", "lift.duration_s", 0.0),
        (PressureSensorNode, "pneumatics", "pneumatics.yaml", "sensing.channel_gain", [1.0] * 15),
        (PressureSensorNode, "pneumatics", "pneumatics.yaml", "sensing.cutoff_hz", -15.0),
        (ValveControllerNode, "pneumatics", "pneumatics.yaml", "controller.rate_limit_pa_s", 0.0),
        (ValveControllerNode, "pneumatics", "pneumatics.yaml", "controller.watchdog_s", True),
        (ValveControllerNode, "gripper", "gripper.yaml", "pressure_limit_gauge_pa", -110e3),
        (GraspArbiterNode, "gripper", "gripper.yaml", "over_pressure_gauge_pa", 110e3),
        (StateEstimatorNode, "gripper", "gripper.yaml", "metamodel", "spline"),
        (StateEstimatorNode, "gripper", "gripper.yaml", "target", "dream"),
        (StateEstimatorNode, "estimator", "estimator.yaml", "bend_time_constant_s", -0.05),
        (StateEstimatorNode, "estimator", "estimator.yaml", "centreline_points", 1),
        (ObjectDetectorNode, "detector", "detector.yaml", "min_object_size_m", -0.008),
        (ObjectDetectorNode, "detector", "detector.yaml", "segmentation.min_area_px", "many"),
        (ObjectDetectorNode, "camera", "camera.yaml", "horizontal_fov_rad", 3.5),
        (GraspArbiterNode, "modes", "modes.yaml", "bend_azimuth_deg.envelope", [225, 315, 45, 130]),
        (GraspArbiterNode, "modes", "modes.yaml", "bend_azimuth_deg.envelope", [225, 315, 45]),
        (GraspArbiterNode, "grasp", "grasp.yaml", "selection.offset_max_m", -0.1),
        (GraspArbiterNode, "grasp", "grasp.yaml", "arbitration.grip_pressure_gauge_pa.envelope", 120e3),
        (GraspArbiterNode, "grasp", "grasp.yaml", "arbitration.settle_dwell_s", -0.2),
    ],
)
def test_a_value_that_cannot_be_is_refused_with_its_place(refused, node_class, parameter, file, path, value):
    complaint = refused(node_class, parameter, changed(file, path, value))
    assert path.split(".")[-1] in complaint or str(value) in complaint


def test_a_pressure_limit_above_the_supply_is_refused(refused):
    too_high = {**changed("gripper.yaml", "pressure_limit_gauge_pa", 250e3), "over_pressure_gauge_pa": 260e3}
    complaint = refused(ValveControllerNode, "gripper", too_high)
    assert "edited.yaml" in complaint and "pneumatics.yaml" in complaint
    assert "limit 250000 Pa" in complaint and "supply 200000 Pa" in complaint


@pytest.mark.parametrize("node_class, others", [(PlantNode, {"scene": "empty"}), (StateEstimatorNode, {})])
def test_a_muscle_for_which_there_is_no_rod_law_is_refused(refused, node_class, others):
    too_long = changed("gripper.yaml", "geometry.active_length_m", 10.0)
    complaint = refused(node_class, "gripper", too_long, **others)
    assert "edited.yaml" in complaint and "no rod law for this muscle" in complaint
