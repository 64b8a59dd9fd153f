"""A synthetic camera image of the scene: analytic ray casting, Lambert shading, soft shadows, sensor noise.

Used where no real camera is: the plant publishes what it returns. Ideal pinhole, no distortion. Frames are all
``gripper_base``, whose z points down when the hand hangs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mbpam_ros.errors import MbpamError
from mbpam_ros.geometry.solids import BOX_CORNERS, SHAPES, Shape
from mbpam_ros.vision.camera import Camera, CameraConfig
from mbpam_ros.vision.capsule_kernel import paint_capsule
from mbpam_ros.vision.raycast import Body, Components, chords, hit_body, surface_normals

Colour = tuple[float, float, float]

AMBIENT, DIFFUSE = 0.42, 0.62
_LIGHT = np.array([0.36, 0.22, -1.0], dtype=np.float32) / np.float32(math.sqrt(0.36**2 + 0.22**2 + 1.0))
_SHADOW_STRENGTH = 0.55
_SHADOW_BLUR_PX = 5.0
_LAMP_REACH_M = 0.45  # the lamp's light on table and floor fades to one half at this distance from the axis
_VOID_LEVEL = 24.0  # rays that meet nothing
_NEAR_M = 0.003  # parts of a finger nearer to the image plane are outside any sensible field of view
_WAVE_LENGTH_M = 0.00714  # the muscle's bellows, drawn as stripes
_STRIPE = 0.10
_DEPTH_NOISE_M, _DEPTH_NOISE_PER_M = 0.0008, 0.004  # standard deviation: a + b z^2
_DEPTH_STEP_M = 0.001
_DEPTH_JUMP_M = 0.012  # a step between neighbours to which a stereo matcher has no answer
_DEPTH_HOLES = 40
_DEPTH_REACH_M = 2.0
_SAG_M = 5e-4  # centrelines are drawn as chords with no more sag than this


@dataclass(frozen=True)
class Lamp:
    """What light falls on fingers and objects.

    Args:
        toward: direction from them to the lamp, in ``gripper_base``, of length 1.
        ambient, diffuse: brightness without the lamp, and what it adds at right angles.
    """

    toward: tuple[float, float, float] = tuple(_LIGHT.tolist())
    ambient: float = AMBIENT
    diffuse: float = DIFFUSE


class ViewError(MbpamError, ValueError):
    """A scene view that cannot be drawn: wrong shapes, sizes, or a floor above the support."""


@dataclass(frozen=True, eq=False)
class ColouredSolid:
    """An object to draw. Sizes as in ``visualization_msgs/Marker``.

    Args:
        shape: sphere (diameters), cylinder (axis along body z; diameter, diameter, length) or box (full extents).
        size_m: (3,).
        position_m: (3,), centre.
        orientation_xyzw: (4,), body to ``gripper_base``.
        colour_rgb: 0 to 1.

    Raises:
        ViewError: unknown shape or a size that is not positive.
    """

    shape: Shape
    size_m: NDArray[np.float64]
    position_m: NDArray[np.float64]
    orientation_xyzw: NDArray[np.float64]
    colour_rgb: Colour = (0.75, 0.30, 0.20)

    def __post_init__(self) -> None:
        if self.shape not in SHAPES:
            raise ViewError(f"shape must be one of {', '.join(SHAPES)}, found {self.shape!r}")
        for name, count in (("size_m", 3), ("position_m", 3), ("orientation_xyzw", 4)):
            value = np.array(getattr(self, name), dtype=float)
            if value.shape != (count,) or not np.isfinite(value).all():
                raise ViewError(f"{name} of a {self.shape} must be {count} finite numbers, found {value}")
            object.__setattr__(self, name, value)
        if (self.size_m <= 0.0).any():
            raise ViewError(f"size_m of a {self.shape} must be positive, found {self.size_m}")


@dataclass(frozen=True, eq=False)
class SceneView:
    """What the camera may see, in ``gripper_base``.

    Args:
        support_depth_m: z of the plane the objects stand on.
        solids: the objects.
        finger_centrelines_m: (4, n, 3) points along the fingers' axes, or ``None`` for no fingers.
        finger_radius_m: their radius.
        support_half_size_m: half extents of the support along x and y (a stand), ``None`` for a table without end.
        support_centre_m: x and y of the stand's middle.
        floor_depth_m: z of the floor below a stand.
        support_rgb, floor_rgb, finger_rgb: colours, 0 to 1.
        lamp: what light falls on fingers and objects; planes and shadows keep that of the default.
        finger_sag_m: centre lines are drawn as chords that stay this near to them.

    Raises:
        ViewError: wrong shapes, or a floor above the support.
    """

    support_depth_m: float
    solids: tuple[ColouredSolid, ...] = ()
    finger_centrelines_m: NDArray[np.float64] | None = None
    finger_radius_m: float = 0.010
    support_half_size_m: tuple[float, float] | None = None
    support_centre_m: tuple[float, float] = (0.0, 0.0)
    floor_depth_m: float = 0.35
    support_rgb: Colour = (0.115, 0.135, 0.165)
    floor_rgb: Colour = (0.095, 0.112, 0.137)
    finger_rgb: Colour = field(default=(0.80, 0.82, 0.84))
    lamp: Lamp = Lamp()
    finger_sag_m: float = _SAG_M

    def __post_init__(self) -> None:
        lines = self.finger_centrelines_m
        if lines is not None and (np.ndim(lines) != 3 or np.shape(lines)[2] != 3 or np.shape(lines)[1] < 2):
            raise ViewError(f"finger_centrelines_m must be (4, n >= 2, 3), found {np.shape(lines)}")
        if self.finger_radius_m <= 0.0:
            raise ViewError(f"finger_radius_m must be positive, found {self.finger_radius_m}")
        if self.support_half_size_m is not None and self.floor_depth_m <= self.support_depth_m:
            raise ViewError(f"the floor ({self.floor_depth_m} m) must be below the support ({self.support_depth_m} m)")


def render(camera: Camera, view: SceneView, rng: np.random.Generator | None = None) -> NDArray[np.uint8]:
    """One image, (H, W, 3) rgb8, without lens blur; see :class:`Renderer` for a stream."""
    return Renderer(camera).render(view, rng)


class Renderer:
    """Draws a stream of images; keeps the rays and the last background.

    Args:
        camera: whose eye.
        noise_levels: standard deviation of the sensor noise [8 bit levels]; needs a generator in :meth:`render`.
        blur_sigma_px: standard deviation of the lens' point spread.
    """

    def __init__(self, camera: Camera, noise_levels: float = 1.5, blur_sigma_px: float = 0.0) -> None:
        self.camera = camera
        self._blur_sigma_px = blur_sigma_px
        k = camera.intrinsics
        self._shape = (k.height_px, k.width_px)
        v, u = np.mgrid[0 : k.height_px, 0 : k.width_px]
        rays = camera.rays(np.stack([u, v], axis=-1)).astype(np.float32)
        self._rays = np.ascontiguousarray(np.moveaxis(rays, -1, 0))
        # One field for all frames, laid over each at a place of its own: to draw a million normals takes 10 ms.
        noise = np.random.default_rng(0).standard_normal(3 * k.height_px * k.width_px, dtype=np.float32)
        self._noise = np.float32(noise_levels) * noise
        self._background_key: tuple[Any, ...] = ()
        self._background: tuple[NDArray[np.float32], NDArray[np.float32]] | None = None

    @classmethod
    def from_config(cls, config: CameraConfig) -> Renderer:
        """The renderer of the camera that ``config`` describes, its noise and blur included."""
        return cls(Camera.from_config(config), config.noise_levels, config.blur_sigma_px)

    def render(self, view: SceneView, rng: np.random.Generator | None = None) -> NDArray[np.uint8]:
        """Draw ``view``: (H, W, 3) rgb8. Noise is added if ``rng`` is given; same seed, same bits."""
        image, _ = self._draw(view)
        if self._blur_sigma_px > 0.0:
            image = cv2.GaussianBlur(image, (5, 5), self._blur_sigma_px).astype(np.float32, copy=False)
        if rng is not None:
            levels, start = image.reshape(-1), int(rng.integers(self._noise.size))
            levels[start:] += self._noise[: self._noise.size - start]
            levels[:start] += self._noise[self._noise.size - start :]
        return cv2.convertScaleAbs(np.maximum(image, 0.0, out=image)).astype(np.uint8, copy=False)

    def render_depth(self, view: SceneView, rng: np.random.Generator | None = None) -> NDArray[np.float32]:
        """Draw the depth of ``view``: (H, W) float32 [m] along the optical axis; NaN where there is no answer.

        With ``rng`` as a consumer sensor gives it: noise that hangs together over some pixels and grows with the
        square of the depth, whole millimetres, no answer at jumps and at random patches.
        """
        _, distance = self._draw(view)
        forward = self.camera.rotation[:, 2].astype(np.float32)
        depth = distance * np.tensordot(forward, self._rays, axes=1)
        depth[~np.isfinite(depth)] = np.nan
        if rng is None:
            return depth.astype(np.float32)
        solid = np.nan_to_num(depth, nan=_DEPTH_REACH_M)
        jump = cv2.morphologyEx(solid, cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8)) > _DEPTH_JUMP_M
        start = int(rng.integers(self._noise.size - depth.size))
        noise = np.array(cv2.GaussianBlur(self._noise[start : start + depth.size].reshape(depth.shape), (0, 0), 1.2))
        noise *= (_DEPTH_NOISE_M + _DEPTH_NOISE_PER_M * solid**2) / max(float(noise.std()), 1e-9)
        depth = _DEPTH_STEP_M * np.round((depth + noise) / _DEPTH_STEP_M)
        holes = np.zeros(depth.shape, np.uint8)
        patches = rng.random((_DEPTH_HOLES, 2)) * depth.shape
        for v, u in patches.astype(int):
            cv2.circle(holes, (int(u), int(v)), 3, 1, -1)
        depth[jump | (holes != 0) | (solid >= _DEPTH_REACH_M)] = np.nan
        return depth.astype(np.float32)

    def _draw(self, view: SceneView) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Image and distance along the rays, without blur and noise."""
        image, distance = self._draw_background(view)
        image, distance = image.copy(), distance.copy()
        for solid in view.solids:
            self._cast_shadow(image, distance, view, solid)
        for solid in view.solids:
            self._draw_solid(image, distance, solid)
        if view.finger_centrelines_m is not None:
            for line in np.asarray(view.finger_centrelines_m, dtype=float):
                self._draw_finger(image, distance, line, view)
        return image, distance

    # -- background ---------------------------------------------------------------------------------------------

    def _draw_background(self, view: SceneView) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        key = (
            view.support_depth_m,
            view.support_half_size_m,
            view.support_centre_m,
            view.floor_depth_m,
            view.support_rgb,
            view.floor_rgb,
        )
        if self._background is None or key != self._background_key:
            image = np.full((*self._shape, 3), _VOID_LEVEL, dtype=np.float32)
            distance = np.full(self._shape, np.inf, dtype=np.float32)
            if view.support_half_size_m is None:
                self._draw_plane(image, distance, view.support_depth_m, view.support_rgb)
            else:
                stand = _stand(view)
                self._draw_plane(image, distance, view.floor_depth_m, view.floor_rgb)
                self._cast_shadow(image, distance, view, stand)
                self._draw_solid(image, distance, stand)
            self._background_key, self._background = key, (image, distance)
        return self._background

    def _draw_plane(self, image: NDArray, distance: NDArray, depth_m: float, colour: Colour) -> None:
        eye, (dx, dy, dz) = self.camera.position_m.astype(np.float32), self._rays
        t = np.where(dz > 1e-3, np.float32(depth_m - eye[2]) / np.maximum(dz, 1e-3), np.inf)
        seen = np.isfinite(t)
        x, y = eye[0] + t[seen] * dx[seen], eye[1] + t[seen] * dy[seen]
        brightness = (AMBIENT - DIFFUSE * _LIGHT[2]) / (1.0 + (x * x + y * y) / _LAMP_REACH_M**2)
        image[seen] = brightness[:, None] * (255.0 * np.array(colour, dtype=np.float32))
        distance[seen] = t[seen]

    def _cast_shadow(self, image: NDArray, distance: NDArray, view: SceneView, solid: ColouredSolid) -> None:
        """Darken what the solid keeps the lamp from, with a penumbra made by blurring in the image."""
        corners = _corners(solid)
        depths = (
            [view.support_depth_m] if view.support_half_size_m is None else [view.support_depth_m, view.floor_depth_m]
        )
        depths = [depth for depth in depths if math.isfinite(depth)]
        if not depths:
            return
        # The shadow lies within the hull of the solid and of its projections along the light.
        reach = [corners]
        for depth in depths:
            fall = np.maximum(depth - corners[:, 2:], 0.0) / float(_LIGHT[2])
            reach.append(corners + fall * _LIGHT.astype(float))
        window = self._window(np.concatenate(reach), pad_px=int(3 * _SHADOW_BLUR_PX))
        if window is None:
            return
        rays, t = self._rays[(slice(None), *window)], distance[window]
        eye = self.camera.position_m.astype(np.float32)
        far = np.where(np.isfinite(t), t, np.float32(1.0))
        points = tuple(e + far * d for e, d in zip(eye, rays, strict=True))
        shadow = np.isfinite(hit_body(_body(solid), points, tuple(_LIGHT))) & np.isfinite(t)
        soft = cv2.GaussianBlur(shadow.astype(np.float32), (0, 0), _SHADOW_BLUR_PX)
        image[window] *= (1.0 - np.float32(_SHADOW_STRENGTH) * soft)[..., None]

    # -- solids and fingers -------------------------------------------------------------------------------------

    def _draw_solid(self, image: NDArray, distance: NDArray, solid: ColouredSolid) -> None:
        window = self._window(_corners(solid))
        if window is None:
            return
        body = _body(solid)
        rays = tuple(self._rays[(slice(None), *window)])
        eye = tuple(self.camera.position_m.astype(np.float32))
        t = hit_body(body, eye, rays)
        seen = t < distance[window]
        points = tuple(e + t[seen] * d[seen] for e, d in zip(eye, rays, strict=True))
        _paint(image[window], distance[window], seen, t, surface_normals(body, points), solid.colour_rgb)

    def _draw_finger(self, image: NDArray, distance: NDArray, line: NDArray, view: SceneView) -> None:
        line = chords(line, view.finger_sag_m)
        stations = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
        for start, end, station in zip(line[:-1], line[1:], stations[:-1], strict=True):
            self._draw_capsule(image, distance, start, end, float(station), view)

    def _draw_capsule(
        self, image: NDArray, distance: NDArray, start: NDArray, end: NDArray, station_m: float, view: SceneView
    ) -> None:
        radius = view.finger_radius_m
        window = self._window(_capsule_corners(start, end, radius))
        if window is None:
            return
        paint_capsule(
            image[window],
            distance[window],
            self._rays[(slice(None), *window)],
            self.camera.position_m - start,
            end - start,
            radius,
            station_m,
            _STRIPE,
            _WAVE_LENGTH_M,
            255.0 * np.array(view.finger_rgb),
            np.array(view.lamp.toward, dtype=float),
            view.lamp.ambient,
            view.lamp.diffuse,
        )

    def _window(self, points_m: NDArray[np.float64], pad_px: int = 2) -> tuple[slice, slice] | None:
        """Rows and columns of the box around the points' projections, ``None`` if outside the image.

        Points nearer to the image plane than ``_NEAR_M`` are moved there along the view, which only widens the box.
        """
        optical = (points_m - self.camera.position_m) @ self.camera.rotation
        if (optical[:, 2] < _NEAR_M).all():
            return None
        k = self.camera.intrinsics
        pixels = optical[:, :2] / np.maximum(optical[:, 2:], _NEAR_M) * (k.fx, k.fy) + (k.cx, k.cy)
        low = np.maximum(np.floor(pixels.min(axis=0)) - pad_px, 0).astype(int)
        high = np.minimum(np.ceil(pixels.max(axis=0)) + pad_px + 1, (k.width_px, k.height_px)).astype(int)
        if (low >= high).any():
            return None
        return slice(low[1], high[1]), slice(low[0], high[0])


def _stand(view: SceneView) -> ColouredSolid:
    assert view.support_half_size_m is not None
    height = view.floor_depth_m - view.support_depth_m
    size = np.array([2.0 * view.support_half_size_m[0], 2.0 * view.support_half_size_m[1], height])
    position = np.array([*view.support_centre_m, view.support_depth_m + 0.5 * height])
    return ColouredSolid("box", size, position, np.array([0.0, 0.0, 0.0, 1.0]), view.support_rgb)


def _body(solid: ColouredSolid) -> Body:
    rotation = Rotation.from_quat(solid.orientation_xyzw).as_matrix()
    return Body(solid.shape, 0.5 * solid.size_m, solid.position_m, rotation)


def _corners(solid: ColouredSolid) -> NDArray[np.float64]:
    """Corners, (8, 3), of the box around the solid."""
    return solid.position_m + Rotation.from_quat(solid.orientation_xyzw).apply(BOX_CORNERS * (0.5 * solid.size_m))


def _capsule_corners(start: NDArray, end: NDArray, radius: float) -> NDArray[np.float64]:
    cube = radius * BOX_CORNERS
    return np.concatenate([start + cube, end + cube])


def _paint(
    image: NDArray, distance: NDArray, seen: NDArray[np.bool_], t: NDArray, normals: Components, colour: Colour
) -> None:
    lit = np.maximum(normals[0] * _LIGHT[0] + normals[1] * _LIGHT[1] + normals[2] * _LIGHT[2], 0.0)
    image[seen] = (AMBIENT + DIFFUSE * lit)[:, None] * (255.0 * np.array(colour, dtype=np.float32))
    distance[seen] = t[seen]
