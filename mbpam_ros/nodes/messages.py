"""Standard messages to SI arrays and back. The one place where names, lengths and units are checked."""

from __future__ import annotations

import array
import math
from collections.abc import Sequence
from contextlib import suppress

import numpy as np
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import Point, Pose, Quaternion, Vector3Stamped
from numpy.typing import ArrayLike, NDArray
from sensor_msgs.msg import Image, JointState
from std_srvs.srv import SetBool, Trigger

from mbpam_ros.answer import Answer
from mbpam_ros.errors import MbpamError
from mbpam_ros.pneumatics.findings import Finding, FindingError

CHANNELS = {"rgb8": 3, "bgr8": 3, "mono8": 1}
"""Encodings of images that are read, and how many bytes each pixel has."""


class MessageError(MbpamError, ValueError):
    """A message does not carry what its topic promises; the text says what is wrong with it."""


def with_answer(response: Trigger.Response | SetBool.Response, answer: Answer) -> Trigger.Response | SetBool.Response:
    """Return the response with the answer in it."""
    response.success, response.message = answer.accepted, answer.reason
    return response


def seconds(stamp: Time) -> float:
    """Return a time stamp as seconds."""
    return stamp.sec + 1e-9 * stamp.nanosec


def time_stamp(time_s: float) -> Time:
    """Return ``time_s`` >= 0 as a time stamp, rounded to the nanosecond."""
    nanoseconds = round(time_s * 1e9)
    return Time(sec=nanoseconds // 1_000_000_000, nanosec=nanoseconds % 1_000_000_000)


def floats(values: ArrayLike | None) -> array.array:
    """Return the values, or none, as the array type that message fields take without a copy per element."""
    if values is None:
        return array.array("d")
    return array.array("d", np.ascontiguousarray(values, dtype=np.float64).tobytes())


def joint_state(
    stamp: Time,
    names: Sequence[str],
    *,
    position: ArrayLike | None = None,
    velocity: ArrayLike | None = None,
    effort: ArrayLike | None = None,
) -> JointState:
    """Build a JointState; what is not given stays empty."""
    return JointStateForm(names).filled(stamp, position=position, velocity=velocity, effort=effort)


class JointStateForm:
    """The JointState of a topic, built once: to make one and to name its channels anew costs five times the values."""

    def __init__(self, names: Sequence[str]) -> None:
        self._message = JointState(name=list(names))

    def filled(
        self,
        stamp: Time,
        *,
        position: ArrayLike | None = None,
        velocity: ArrayLike | None = None,
        effort: ArrayLike | None = None,
    ) -> JointState:
        """Return the message with these values, for publication before the next call: it is always the same object."""
        message = self._message
        message.header.stamp = stamp
        message.position, message.velocity, message.effort = floats(position), floats(velocity), floats(effort)
        return message


def rgb_image(pixels: NDArray[np.uint8]) -> Image:
    """Return pixels, (H, W, 3) rgb8, as a message without header."""
    height, width, _ = pixels.shape
    image = Image(encoding="rgb8", height=height, width=width, step=3 * width)
    image.data = array.array("B", np.ascontiguousarray(pixels).tobytes())
    return image


def image_pixels(message: Image) -> NDArray[np.uint8]:
    """Return the image as (H, W, 3) or, for mono8, (H, W).

    Raises:
        MessageError: another encoding than those of :data:`CHANNELS`, or fewer bytes than size and step say.
    """
    channels = CHANNELS.get(message.encoding)
    if channels is None:
        raise MessageError(f"encoding {message.encoding!r} is none of {', '.join(CHANNELS)}")
    row_bytes = message.width * channels
    if row_bytes == 0 or message.step < row_bytes or len(message.data) != message.step * message.height:
        raise MessageError(
            f"{message.width} x {message.height} {message.encoding} with step {message.step} does not fit "
            f"{len(message.data)} bytes"
        )
    rows = np.frombuffer(message.data, dtype=np.uint8).reshape(message.height, message.step)[:, :row_bytes]
    shape = (message.height, message.width) if channels == 1 else (message.height, message.width, channels)
    return np.ascontiguousarray(rows).reshape(shape)


def named_values(
    message: JointState, names: tuple[str, ...], field: str, optional: str | None = None
) -> NDArray[np.float64]:
    """Return ``field`` of a JointState in the order of ``names``, shape (len(names),). Values may be NaN.

    The message may name its channels in any order, but must name each exactly once.

    Args:
        optional: a name that may be there besides, once; its value then comes last, one more.

    Raises:
        MessageError: unknown, missing or repeated names, or a field of another length.
    """
    values = np.array(getattr(message, field), dtype=np.float64)
    if len(values) != len(message.name):
        raise MessageError(f"{len(message.name)} names but {len(values)} values in {field}")
    given = tuple(message.name)
    if optional is not None and optional in given:
        names = (*names, optional)
    if given == names:
        return values
    unknown = sorted(set(given) - set(names))
    if unknown:
        raise MessageError(f"unknown names: {_listing(unknown)}; expected {names[0]} .. {names[-1]}")
    missing = sorted(set(names) - set(given))
    if missing:
        raise MessageError(f"missing names: {_listing(missing)}")
    if len(given) != len(names):
        raise MessageError(f"{len(given)} names, some of them twice, for {len(names)} channels")
    index = {name: i for i, name in enumerate(given)}
    return values[[index[name] for name in names]]


def findings_in(report: DiagnosticStatus) -> list[Finding]:
    """Return the findings that a health report carries among its values, by the channels' names."""
    found = []
    for item in report.values:
        with suppress(FindingError):
            found.append(Finding.parse(item.key, item.value))
    return found


def point(position_m: Sequence[float] | NDArray[np.float64]) -> Point:
    """Return three coordinates as a Point."""
    x, y, z = (float(value) for value in position_m)
    return Point(x=x, y=y, z=z)


def pose(
    position_m: Sequence[float] | NDArray[np.float64], orientation_xyzw: Sequence[float] | NDArray[np.float64]
) -> Pose:
    """Return position and quaternion (x, y, z, w) as a Pose."""
    x, y, z, w = (float(value) for value in orientation_xyzw)
    return Pose(position=point(position_m), orientation=Quaternion(x=x, y=y, z=z, w=w))


def pose_arrays(message: Pose) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return position (3,) and unit quaternion (4,), x y z w, of a Pose.

    Raises:
        MessageError: a coordinate is not finite, or the quaternion has no length.
    """
    position = np.array([message.position.x, message.position.y, message.position.z])
    orientation = np.array([message.orientation.x, message.orientation.y, message.orientation.z, message.orientation.w])
    length = math.sqrt(float(orientation @ orientation))
    if not (np.isfinite(position).all() and math.isfinite(length)) or length < 1e-9:
        raise MessageError("pose with a coordinate that is not finite or a quaternion of no length")
    return position, orientation / length


def direction(message: Vector3Stamped, frame_id: str) -> NDArray[np.float64]:
    """Return the unit vector (3,) along which a vector in a frame points.

    Raises:
        MessageError: another frame, a value that is not finite, or a vector without a direction.
    """
    if message.header.frame_id != frame_id:
        raise MessageError(f"frame {message.header.frame_id!r}; the vector must be in {frame_id}")
    vector = np.array([message.vector.x, message.vector.y, message.vector.z])
    length = float(np.linalg.norm(vector))
    if not 0.0 < length < np.inf:
        raise MessageError(f"the vector ({', '.join(f'{part:g}' for part in vector)}) has no direction")
    unit: NDArray[np.float64] = vector / length
    return unit


def _listing(names: list[str]) -> str:
    shown = ", ".join(names[:3])
    return shown if len(names) <= 3 else f"{shown} and {len(names) - 3} more"
