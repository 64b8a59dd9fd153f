"""Laws of the pinhole for any pose and pixel."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.spatial.transform import Rotation

from mbpam_ros.vision.camera import Camera, CameraPose, Intrinsics

focal = st.floats(100.0, 900.0)
pixels = hnp.arrays(float, (7, 2), elements=st.floats(0.0, 480.0))


@st.composite
def cameras(draw):
    tilt = draw(hnp.arrays(float, 3, elements=st.floats(-0.25, 0.25)))
    position = draw(hnp.arrays(float, 3, elements=st.floats(-0.05, 0.05)))
    intrinsics = Intrinsics(640, 480, draw(focal) + 300.0, draw(focal) + 300.0, draw(st.floats(200, 400)), 240.0)
    return Camera(intrinsics, CameraPose(Rotation.from_rotvec(tilt).as_matrix(), position))


@given(cameras(), pixels, st.floats(0.05, 2.0))
def test_every_point_of_a_ray_projects_to_its_pixel(camera, pixel, distance):
    np.testing.assert_allclose(camera.project(camera.position_m + distance * camera.rays(pixel)), pixel, atol=1e-7)
