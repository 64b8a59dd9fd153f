"""The bend in a picture of a muscle's side: sub-degree at any tilt and lamp, and one line for no muscle."""

import dataclasses
import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mbpam_ros.actuator.calibration import pattern_loads
from mbpam_ros.actuator.planar_rod import rod_tip_angle, upright_axis_m
from mbpam_ros.actuator.rod_law import finite_element_rod_law
from mbpam_ros.gripper import load_gripper
from mbpam_ros.vision.camera import Camera, CameraPose, load_camera_config
from mbpam_ros.vision.render import Lamp, Renderer, SceneView
from mbpam_ros.vision.side_markers import MarkerError, bend_between_markers, marker_strips
from mbpam_ros.vision.side_view import MuscleSize, SilhouetteError, bend_in_picture

pytestmark = pytest.mark.slow

GEOMETRY = load_gripper().rod_geometry
CONFIG = load_camera_config("rig_camera.yaml")
SIZE = MuscleSize(GEOMETRY.outer_radius_m, GEOMETRY.end_length_m, GEOMETRY.length_m, GEOMETRY.outer_radius_m)
LAW = finite_element_rod_law()
BLUE = (0.1, 0.25, 0.9)


def upright(pressure_pa, side=1.0):
    """Tip angle and axis, in the rig's frame, of two chambers under pressure."""
    (load,) = pattern_loads(LAW, "pdc", [pressure_pa])
    args = load.moment_n_m, load.stiffness_n_m2, GEOMETRY
    angle = rod_tip_angle(*args, stretch=load.stretch)
    x, z = upright_axis_m(angle, *args, load.stretch).T
    return side * angle, np.column_stack([side * x, 0.0 * x, z])


def tilted(rng):
    """The camera turned about its view by up to 10 deg, and by up to 4 deg out of the square with the bend."""
    square, look_at = Camera.from_config(CONFIG), np.array(CONFIG.look_at_m)
    roll, *aslant = np.radians(rng.uniform([-10, -4, -4], [10, 4, 4]))
    turn = Rotation.from_euler("zx", aslant).as_matrix()
    rotation = turn @ square.rotation @ Rotation.from_euler("z", roll).as_matrix()
    return Camera(square.intrinsics, CameraPose(rotation, look_at + turn @ (square.position_m - look_at)))


def picture(camera, axis, rng, lamp=None, strips=0):
    solids = marker_strips(axis, GEOMETRY.outer_radius_m, np.array([0.0, -1.0, 0.0]), BLUE)[:strips]
    view = SceneView(math.inf, solids, axis[None], finger_sag_m=2e-5, lamp=lamp or Lamp())
    return Renderer(camera, CONFIG.noise_levels, CONFIG.blur_sigma_px).render(view, rng)


def test_at_20_tilts_and_lamps_the_bend_is_within_a_degree_by_silhouette_and_by_markers():
    rng, strip_rng = (np.random.default_rng(seed) for seed in (3, 4))
    errors = []
    for pressure_pa in np.linspace(0.0, 100e3, 20):
        true, axis = upright(pressure_pa, side=rng.choice([-1.0, 1.0]))
        lamp = rng.normal(size=3)
        lamp[1] = -abs(lamp[1])  # on the camera's side
        lamp = Lamp(tuple(lamp / np.linalg.norm(lamp)), rng.uniform(0.25, 0.5), rng.uniform(0.3, 0.7))
        camera = tilted(rng)
        by_silhouette = bend_in_picture(picture(camera, axis, rng, lamp), camera, SIZE)
        by_markers = bend_between_markers(picture(camera, axis, strip_rng, lamp, strips=2), camera, BLUE)
        errors.append([math.degrees(found.bend_rad - true) for found in (by_silhouette, by_markers)])
    assert np.sqrt(np.mean(np.square(errors), axis=0)).max() < 0.3
    assert (np.abs(errors).max(axis=0) < [0.6, 1.0]).all()


@pytest.mark.parametrize(
    ("strips", "colour", "message"),
    [
        (0, BLUE, "no strip of that colour"),
        (1, BLUE, "1 strip of that colour is in the picture, two are needed"),
        (2, (0.5, 0.5, 0.52), "nearly grey"),
    ],
)
def test_without_two_strips_there_is_no_bend_between_them(strips, colour, message):
    camera, rng = Camera.from_config(CONFIG), np.random.default_rng(0)
    with pytest.raises(MarkerError, match=message) as error:
        bend_between_markers(picture(camera, upright(30e3)[1], rng, strips=strips), camera, colour)
    assert "\n" not in str(error.value)


def test_a_dark_muscle_on_a_bright_ground_has_the_same_bend():
    true, axis = upright(60e3)
    camera, rng = Camera.from_config(CONFIG), np.random.default_rng(0)
    bright = picture(camera, axis, rng)
    seen = [bend_in_picture(image, camera, SIZE).bend_rad for image in (bright, 255 - bright)]
    assert seen == pytest.approx([true, true], abs=math.radians(0.3))


@pytest.mark.parametrize("what", ["nothing", "half", "clamp outside"])
def test_what_shows_no_whole_muscle_is_one_line(what):
    camera, rng = Camera.from_config(CONFIG), np.random.default_rng(0)
    image = picture(camera, upright(30e3)[1], rng)
    if what == "nothing":
        image[:] = 24
    elif what == "half":
        image[:250] = 24
    else:
        camera = Camera(
            dataclasses.replace(camera.intrinsics, cy=900.0), CameraPose(camera.rotation, camera.position_m)
        )
    with pytest.raises(
        SilhouetteError, match="no silhouette at the clamp|mm long, the muscle|not well inside"
    ) as error:
        bend_in_picture(image, camera, SIZE)
    assert "\n" not in str(error.value)
