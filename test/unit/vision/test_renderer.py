"""The synthetic image against closed forms."""

import math

import numpy as np
import pytest

from mbpam_ros.vision.camera import Camera, load_camera_config
from mbpam_ros.vision.capsule_kernel import paint_capsule
from mbpam_ros.vision.raycast import chords, hit_box, hit_capsule, hit_cylinder, hit_sphere
from mbpam_ros.vision.render import ColouredSolid, Renderer, SceneView, ViewError, render

UPRIGHT = np.array([0.0, 0.0, 0.0, 1.0])
ALONG_Y = np.array([-math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)])  # turns the body's z axis to y
WHITE = (1.0, 1.0, 1.0)
DEPTH_M = 0.13


@pytest.fixture(scope="module")
def camera():
    return Camera.from_config(load_camera_config())


def silhouette(camera, *solids, **view):
    """Pixels that the solids change beyond what a shadow could: the table is black, they are white."""
    scene = SceneView(DEPTH_M, solids, support_rgb=(0.0, 0.0, 0.0), **view)
    return render(camera, scene).max(axis=2) > 40


def rays(*directions):
    d = np.array(directions, dtype=float)
    return tuple((d / np.linalg.norm(d, axis=1, keepdims=True)).T)


def test_rays_meet_primitives_where_algebra_says():
    down = rays((0, 0, 1), (1, 0, 0))
    assert hit_sphere((0, 0, -5.0), down, 2.0).tolist() == [3.0, math.inf]
    assert hit_cylinder((0, 0, -5.0), down, 1.0, 2.0).tolist() == [3.0, math.inf]
    assert hit_cylinder((-5.0, 0, 1.0), down, 1.0, 2.0).tolist() == [math.inf, 4.0]
    assert hit_box((-5.0, 0, 0), down, np.array([1.0, 2.0, 3.0])).tolist() == [math.inf, 4.0]
    assert hit_capsule((0, 0, -5.0), down, np.array([0.0, 0.0, 4.0]), 1.0)[0] == pytest.approx(4.0)
    assert hit_capsule((-5.0, 0, 2.0), down, np.array([0.0, 0.0, 4.0]), 1.0)[1] == pytest.approx(4.0)
    assert hit_capsule((-5.0, 0, 4.5), down, np.array([0.0, 0.0, 4.0]), 1.0)[1] == pytest.approx(5.0 - math.sqrt(0.75))


def test_the_compiled_capsule_is_hit_where_the_array_formula_says():
    rng = np.random.default_rng(7)
    d = rng.normal(size=(3, 40, 50))
    directions = (d / np.linalg.norm(d, axis=0)).astype(np.float32)
    hit = 0
    for _ in range(50):
        start, axis, radius = rng.normal(size=3), rng.normal(size=3), rng.uniform(0.05, 0.8)
        distance = np.full((40, 50), np.inf, dtype=np.float32)
        image, brightness = np.zeros((40, 50, 3), dtype=np.float32), (200.0 * np.ones(3), np.array([0.0, 0.0, -1.0]))
        paint_capsule(image, distance, directions, -start, axis, radius, 0.0, 0.1, 0.05, *brightness, 0.4, 0.6)
        expected = hit_capsule(tuple(-start), tuple(directions.astype(float)), axis, radius)
        # Rays that graze it may go either way.
        clear = np.isfinite(expected) == np.isfinite(distance)
        assert np.mean(clear) > 0.999
        np.testing.assert_allclose(distance[clear], expected[clear], rtol=1e-4)
        np.testing.assert_array_equal(image.max(axis=2) > 0.0, np.isfinite(distance))
        hit += np.isfinite(distance).sum()
    assert hit > 1000


def test_what_lies_behind_the_eye_is_not_hit():
    assert hit_sphere((0, 0, 5.0), rays((0, 0, 1)), 2.0).tolist() == [math.inf]
    assert hit_box((0, 0, 5.0), rays((0, 0, 1)), np.ones(3)).tolist() == [math.inf]


@pytest.mark.parametrize("position", [(0.0, 0.0, 0.095), (-0.02, 0.03, 0.10)])
def test_a_spheres_silhouette_has_the_area_of_its_projected_ellipse(camera, position):
    radius = 0.03
    mask = silhouette(camera, ColouredSolid("sphere", np.full(3, 2 * radius), np.array(position), UPRIGHT, WHITE))
    centre = (np.array(position) - camera.position_m) @ camera.rotation
    # The cone of half angle alpha about a direction beta off the axis cuts the image plane in an ellipse.
    distance = np.linalg.norm(centre)
    alpha, beta = math.asin(radius / distance), math.acos(centre[2] / distance)
    wide = 0.5 * (math.tan(beta + alpha) - math.tan(beta - alpha))
    narrow = math.sin(alpha) / math.sqrt(math.cos(beta + alpha) * math.cos(beta - alpha))
    area = math.pi * wide * narrow * camera.intrinsics.fx * camera.intrinsics.fy
    assert mask.sum() == pytest.approx(area, rel=0.003)


def test_a_boxs_silhouette_ends_at_its_projected_corners(camera):
    half = np.array([0.0175, 0.06, 0.03])
    centre = np.array([-0.005, 0.004, DEPTH_M - half[2]])
    mask = silhouette(camera, ColouredSolid("box", 2 * half, centre, UPRIGHT, WHITE))
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    corners = camera.project(centre + signs * half)
    rows, columns = np.nonzero(mask)
    assert [columns.min(), rows.min()] == pytest.approx(corners.min(axis=0), abs=1.0)
    assert [columns.max(), rows.max()] == pytest.approx(corners.max(axis=0), abs=1.0)


def test_a_cylinder_lies_along_its_body_z_axis(camera):
    rod = ColouredSolid("cylinder", np.array([0.02, 0.02, 0.2]), np.array([0.0, 0.0, 0.12]), ALONG_Y, WHITE)
    mask = silhouette(camera, rod)
    on, off = ([0.0, 0.09, 0.115], [0.0, -0.09, 0.115]), ([0.03, 0.0, 0.12], [-0.03, 0.0, 0.12])
    for points, expected in ((on, True), (off, False)):
        for u, v in camera.project(points).round().astype(int):
            assert mask[v, u] == expected


def test_the_nearer_of_two_solids_hides_the_other(camera):
    low = ColouredSolid("box", np.full(3, 0.04), np.array([0.0, 0.0, 0.11]), UPRIGHT, (1.0, 0.0, 0.0))
    high = ColouredSolid("sphere", np.full(3, 0.02), np.array([0.0, 0.0, 0.06]), UPRIGHT, (0.0, 1.0, 0.0))
    for order in ((low, high), (high, low)):
        image = render(camera, SceneView(DEPTH_M, order))
        u, v = camera.project([0.0, 0.0, 0.06]).round().astype(int)
        assert image[v, u, 1] > 50 and image[v, u, 0] == 0


def test_a_shadow_darkens_the_table_beside_the_object_and_nothing_else(camera):
    box = ColouredSolid("box", np.array([0.03, 0.03, 0.02]), np.array([0.0, 0.04, DEPTH_M - 0.01]), UPRIGHT, WHITE)
    bare = render(camera, SceneView(DEPTH_M, support_rgb=(0.5, 0.5, 0.5))).astype(int)
    shaded = render(camera, SceneView(DEPTH_M, (box,), support_rgb=(0.5, 0.5, 0.5))).astype(int)
    # The lamp stands toward +x, +y, so the shadow falls toward -x, -y.
    for point, darker in (((-0.006, 0.0225, DEPTH_M), True), ((0.03, -0.01, DEPTH_M), False)):
        u, v = camera.project(point).round().astype(int)
        assert (shaded[v, u, 0] < 0.8 * bare[v, u, 0]) == darker


def test_a_stand_leaves_the_floor_around_it_in_view(camera):
    stand = dict(support_half_size_m=(0.02, 0.03), support_rgb=(0.9, 0.1, 0.1), floor_rgb=(0.1, 0.1, 0.9))
    image = render(camera, SceneView(DEPTH_M, **stand))
    for point, channel in (((0.0, 0.02, DEPTH_M), 0), ((0.0, 0.04, DEPTH_M), 2)):
        u, v = camera.project(point).round().astype(int)
        assert image[v, u].argmax() == channel


def test_fingers_cover_what_is_behind_them(camera):
    line = np.array([[[-0.03, 0.03, 0.02], [-0.03, 0.03, 0.07], [-0.03, 0.03, 0.12]]])
    mask = silhouette(camera, finger_centrelines_m=line, finger_rgb=WHITE)
    tip, beyond = camera.project([[-0.03, 0.03, 0.11], [-0.03, 0.03 - 0.02, 0.11]]).round().astype(int)
    assert mask[tip[1], tip[0]] and not mask[beyond[1], beyond[0]]


def test_a_straight_centreline_becomes_one_chord_and_a_bent_one_stays_within_its_sag():
    angle = np.linspace(0.0, 1.2, 40)
    arc = 0.1 * np.column_stack([1.0 - np.cos(angle), np.zeros_like(angle), np.sin(angle)])
    kept = chords(arc, 5e-4)
    widest = max(np.linalg.norm(np.diff(kept, axis=0), axis=1))
    assert len(kept) < 12
    assert 0.1 * (1.0 - math.cos(math.asin(widest / 0.2))) < 5.5e-4
    assert len(chords(np.linspace([0, 0, 0], [0, 0, 1.0], 9), 5e-4)) == 2


def test_the_same_seed_gives_the_same_bits_and_another_seed_does_not(camera):
    renderer = Renderer(camera, noise_levels=2.0, blur_sigma_px=0.6)
    view = SceneView(DEPTH_M, support_rgb=(0.5, 0.5, 0.5))
    first, same, other = (renderer.render(view, np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert np.array_equal(first, same)
    clean = renderer.render(view).astype(float)
    assert np.std(other - clean) == pytest.approx(2.0, rel=0.05)
    assert not np.array_equal(first, other)


def test_drawing_a_scene_leaves_no_trace_in_the_next(camera):
    renderer = Renderer(camera)
    ball = ColouredSolid("sphere", np.full(3, 0.05), np.array([0.0, 0.0, 0.1]), UPRIGHT)
    empty = renderer.render(SceneView(DEPTH_M))
    renderer.render(SceneView(DEPTH_M, (ball,)))
    assert np.array_equal(renderer.render(SceneView(DEPTH_M)), empty)


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: ColouredSolid("cone", np.ones(3), np.zeros(3), UPRIGHT),
        lambda: ColouredSolid("box", np.array([1.0, 0.0, 1.0]), np.zeros(3), UPRIGHT),
        lambda: ColouredSolid("box", np.ones(3), np.full(3, np.nan), UPRIGHT),
        lambda: SceneView(0.13, finger_centrelines_m=np.zeros((4, 3))),
        lambda: SceneView(0.13, support_half_size_m=(0.02, 0.02), floor_depth_m=0.1),
        lambda: SceneView(0.13, finger_radius_m=0.0),
    ],
)
def test_views_that_cannot_be_drawn_are_refused(wrong):
    with pytest.raises(ViewError):
        wrong()
