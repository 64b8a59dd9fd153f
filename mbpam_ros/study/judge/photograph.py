"""MuJoCo draws a scene off-screen: colour, the same without its objects, and depth as a consumer sensor gives it.

MuJoCo's world has z up: it is ``gripper_base`` turned by half a turn about x. Needs the extra ``bench``, and a way to
draw without a screen (``MUJOCO_GL=egl`` or ``osmesa``).
"""

from __future__ import annotations

import math
import os

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mbpam_ros.gripper import load_gripper
from mbpam_ros.study.judge.scenes import TABLES, JudgedScene, Photographs, Split, Thing
from mbpam_ros.study.judge.tables import TEXTURE_SIDE_M, texture

os.environ.setdefault("MUJOCO_GL", "egl")
import mujoco  # reads MUJOCO_GL when imported

_FLIP = Rotation.from_euler("x", 180.0, degrees=True)
_NEAR_M = 0.006
_TABLE_HALF_M = 1.2
_DEPTH_STEP_M = 0.001
_DEPTH_NOISE_M = 0.0008  # at the palm; grows with the square of the distance, as a stereo sensor's
_DEPTH_NOISE_PER_M = 0.004
_HOLE_SHARE = 0.01


def photograph(scene: JudgedScene, split: Split) -> Photographs:
    """Draw the scene. Same scene, same images on the same machine."""
    rng = np.random.default_rng((scene.seed, 77))
    assets = {"table.png": _png(texture(TABLES[split], scene.table, rng))}
    for index, thing in enumerate(scene.things):
        if thing.label:
            assets[f"label_{index}.png"] = _png(_label(thing.rgb, rng))
    clean, depth = _draw(scene, scene.things, assets)
    empty, _ = _draw(scene, (), assets)
    image = _sensor(clean, scene.noise_levels, rng)
    gain, shift = rng.uniform(0.93, 1.07), rng.uniform(-1.5, 1.5, 2)
    move = np.array([[1.0, 0.0, shift[0]], [0.0, 1.0, shift[1]]])
    moved = cv2.warpAffine(empty, move, empty.shape[1::-1], borderMode=cv2.BORDER_REPLICATE)
    backgrounds = np.stack([_sensor(np.clip(gain * moved, 0, 255), scene.noise_levels, rng) for _ in range(4)])
    return Photographs(image, backgrounds, _sensed_depth(depth, rng))


def _png(rgb: NDArray[np.uint8]) -> bytes:
    return cv2.imencode(".png", np.ascontiguousarray(rgb[..., ::-1]))[1].tobytes()


def _label(rgb: NDArray, rng: np.random.Generator) -> NDArray[np.uint8]:
    """A printed pattern: bars and patches of a second colour."""
    image = np.tile(rgb, (128, 128, 1))
    other = np.clip(rgb + rng.uniform(-0.5, 0.5, 3), 0.0, 1.0)
    for _ in range(int(rng.integers(2, 7))):
        top, left = rng.integers(0, 110, 2)
        image[top : top + int(rng.integers(6, 50)), left : left + int(rng.integers(6, 90))] = other
    return np.asarray(255.0 * image, dtype=np.uint8)


def _sensor(image: NDArray, noise_levels: float, rng: np.random.Generator) -> NDArray[np.uint8]:
    """The lens' blur, and noise."""
    blurred = cv2.GaussianBlur(image.astype(np.float32), (0, 0), 0.7)
    noisy = blurred + noise_levels * rng.standard_normal(image.shape, dtype=np.float32)
    return np.clip(np.round(noisy), 0, 255).astype(np.uint8)


def _sensed_depth(depth: NDArray[np.float32], rng: np.random.Generator) -> NDArray[np.float32]:
    """Noise, whole millimetres, no answer at jumps and at random patches."""
    jump = cv2.morphologyEx(depth, cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8)) > 0.012
    holes = jump & (rng.random(depth.shape) < 0.7)
    seeds = (rng.random(depth.shape) < _HOLE_SHARE / 40.0).astype(np.uint8)
    holes |= cv2.dilate(seeds, np.ones((7, 7), np.uint8)).astype(bool)
    # A stereo matcher's error hangs together over some pixels.
    noise = np.asarray(cv2.GaussianBlur(rng.standard_normal(depth.shape), (0, 0), 1.2))
    noise = noise / noise.std()
    sensed = np.asarray(depth + noise * (_DEPTH_NOISE_M + _DEPTH_NOISE_PER_M * depth**2))
    sensed = np.asarray(_DEPTH_STEP_M * np.round(sensed / _DEPTH_STEP_M))
    sensed[holes | (depth > 2.0)] = np.nan
    return sensed.astype(np.float32)


def _draw(
    scene: JudgedScene, things: tuple[Thing, ...], assets: dict[str, bytes]
) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    model = mujoco.MjModel.from_xml_string(_xml(scene, things), assets)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    k = scene.intrinsics
    renderer = mujoco.Renderer(model, k.height_px, k.width_px)
    try:
        renderer.update_scene(data, "eye")
        image = renderer.render().copy()
        renderer.enable_depth_rendering()
        renderer.update_scene(data, "eye")
        return image, renderer.render().astype(np.float32)
    finally:
        renderer.close()


def _vector(values: object) -> str:
    return " ".join(f"{value:.6g}" for value in np.asarray(values, dtype=float).ravel())


def _place(position_m: NDArray, rotation: Rotation) -> str:
    turned = (_FLIP * rotation).as_quat()
    return f'pos="{_vector(_FLIP.apply(position_m))}" quat="{_vector(turned[[3, 0, 1, 2]])}"'


def _xml(scene: JudgedScene, things: tuple[Thing, ...]) -> str:
    k = scene.intrinsics
    fovy = math.degrees(2.0 * math.atan(0.5 * k.height_px / k.fy))
    repeat = 2.0 * _TABLE_HALF_M / TEXTURE_SIDE_M
    materials = [
        '<texture name="table" type="2d" file="table.png"/>',
        f'<material name="table" texture="table" texrepeat="{repeat:g} {repeat:g}" specular="0.05" reflectance="0"/>',
    ]
    table_z = -scene.support_depth_m
    bodies = [
        f'<geom type="plane" size="{_TABLE_HALF_M} {_TABLE_HALF_M} 0.1" pos="0 0 {table_z:.6g}" material="table"/>'
    ]
    for x, y, yaw, half_width, half_length in scene.papers:
        place = _place(np.array([x, y, scene.support_depth_m]), Rotation.from_euler("z", yaw))
        bodies.append(f'<geom type="box" size="{half_width:.6g} {half_length:.6g} 0.0002" {place} rgba="1 1 .95 1"/>')
    for lamp in scene.lamps:
        position, toward = _FLIP.apply(lamp.position_m), _FLIP.apply(lamp.toward_m)
        bodies.append(
            f'<light pos="{_vector(position)}" dir="{_vector(toward - position)}" castshadow="true" cutoff="60" '
            f'exponent="1" diffuse="{_vector([lamp.brightness] * 3)}" specular="{_vector([lamp.brightness] * 3)}"/>'
        )
    for index, thing in enumerate(things):
        if thing.label:
            materials.append(f'<texture name="label_{index}" type="cube" file="label_{index}.png"/>')
            look = f'texture="label_{index}"'
        else:
            look = f'rgba="{_vector([*thing.rgb, 1.0])}"'
        materials.append(f'<material name="thing_{index}" {look} specular="{thing.shininess:.3g}" shininess="0.6"/>')
        for part in thing.parts:
            place = _place(thing.position_m + thing.rotation.apply(part.position_m), thing.rotation * part.rotation)
            bodies.append(f'<geom type="{part.kind}" size="{_vector(part.size_m)}" {place} material="thing_{index}"/>')
    if scene.fingers:
        gripper = load_gripper()
        length, radius = gripper.geometry.length_m, gripper.geometry.outer_radius_m
        for base in gripper.finger_base_m:
            place = _place(base + (0.0, 0.0, 0.5 * length), Rotation.identity())
            bodies.append(f'<geom type="cylinder" size="{radius:.6g} {0.5 * length:.6g}" {place} rgba=".8 .82 .84 1"/>')
    # A camera of MuJoCo looks along its -z, with y up: the optical frame turned by half a turn about x.
    eye = _place(scene.pose.position_m, Rotation.from_matrix(scene.pose.rotation) * _FLIP)
    ambient = _vector([scene.ambient] * 3)
    return f"""<mujoco>
  <statistic extent="1" center="0 0 0"/>
  <visual>
    <global offwidth="{k.width_px}" offheight="{k.height_px}"/>
    <quality shadowsize="4096" offsamples="4"/>
    <headlight ambient="{ambient}" diffuse="0 0 0" specular="0 0 0"/>
    <map znear="{_NEAR_M}" zfar="4"/>
  </visual>
  <asset>{"".join(materials)}</asset>
  <worldbody>{"".join(bodies)}<camera name="eye" fovy="{fovy:.6g}" {eye}/></worldbody>
</mujoco>"""
