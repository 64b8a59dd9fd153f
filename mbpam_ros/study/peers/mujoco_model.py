"""The peers' problem in MuJoCo: a chain of rigid links with two hinges an element.

The active part is cut into N elements of length l = L / N. Both hinges of an element stand in its middle and carry its
bending: stiffness B / l, damping eta B / l, and a rest angle that makes the moment M0. The first hinge's axis is normal
to the plane of the muscle's moment, so that a plane bend is one of the first hinges alone. Links are slender rods, as
ours are; MuJoCo needs an inertia about their axes too, which plays no part in a plane bend. Armature is 0.
"""

from __future__ import annotations

from types import ModuleType
from xml.etree import ElementTree

import numpy as np

from mbpam_ros.study.peers.grasp import GRASP_S, Grasp, hand_motion
from mbpam_ros.study.peers.problem import Array, FingerProblem, PeerMissingError

CONE, IMPRATIO = "elliptic", 10.0
INTEGRATORS = ("discrete", "implicitfast", "implicit")
"""What the search tries, where the installed version has it."""

_FINGER, _STAND = 1, 2
"""Bits of what the sphere touches. Fingers touch neither each other nor the stand, as in ours."""

_HAND_KG = 1e4
"""The hand's motion is given; next to it the fingers weigh nothing."""


def load_mujoco() -> ModuleType:
    """Import MuJoCo.

    Raises:
        PeerMissingError: it is not installed.
    """
    try:
        import mujoco
    except ImportError as error:
        raise PeerMissingError("MuJoCo is not installed: pip install 'mbpam_ros[bench]'") from error
    return mujoco


def link_spans(problem: FingerProblem, elements: int) -> Array:
    """Return start and end of the N + 1 links along the muscle, shape (N + 1, 2) [m]; the first is clamped."""
    geometry = problem.geometry
    hinges = geometry.end_length_m + (np.arange(elements) + 0.5) * geometry.active_length_m / elements
    ends = np.concatenate([[0.0], hinges, [geometry.length_m]])
    return np.column_stack([ends[:-1], ends[1:]])


def model_xml(problem: FingerProblem, elements: int, step_s: float, integrator: str, grasp: Grasp | None = None) -> str:
    """Return the model as MJCF, world z up; without a grasp nothing touches and the hand stands still."""
    root = ElementTree.Element("mujoco")
    ElementTree.SubElement(root, "compiler", angle="radian")
    options = {
        "timestep": _text(step_s), "integrator": integrator, "cone": CONE, "impratio": _text(IMPRATIO),
        "gravity": _text(0, 0, -problem.gravity_m_s2),
    }  # fmt: skip
    option = ElementTree.SubElement(root, "option", options)
    if grasp is None:
        ElementTree.SubElement(option, "flag", contact="disable", constraint="disable")
    world = ElementTree.SubElement(root, "worldbody")
    palm = world
    if grasp is not None:
        palm = ElementTree.SubElement(world, "body", name="hand", gravcomp="1")
        ElementTree.SubElement(palm, "joint", name="lift", type="slide", axis="0 0 1")
        _inertial(palm, 0.0, _HAND_KG, (1.0, 1.0, 1.0))
        _add_sphere(world, grasp)
    for finger in range(len(problem.base_m)):
        _add_finger(palm, problem, elements, finger, grasp)
    return ElementTree.tostring(root, encoding="unicode")


def _add_finger(
    palm: ElementTree.Element, problem: FingerProblem, elements: int, finger: int, grasp: Grasp | None
) -> None:
    spans, radius = link_spans(problem, elements), problem.geometry.outer_radius_m
    share = problem.geometry.active_length_m / elements
    stiffness = problem.stiffness_n_m2 / share
    toward = problem.inward[finger]
    # x axis of the links toward the palm's axis, z down the muscle: y is then -(z_up x toward).
    axes = _text(toward[0], toward[1], 0, toward[1], -toward[0], 0)
    base = problem.base_m[finger]
    body = ElementTree.SubElement(
        palm, "body", name=f"finger_{finger}", pos=_text(base[0], base[1], -base[2]), xyaxes=axes
    )
    for index, (start, end) in enumerate(spans):
        length = end - start
        if index > 0:
            body = ElementTree.SubElement(body, "body", pos=_text(0, 0, start - spans[index - 1, 0]))
            for axis, rest in (("0 1 0", problem.moment_n_m / stiffness), ("1 0 0", 0.0)):
                ElementTree.SubElement(
                    body, "joint", type="hinge", axis=axis, stiffness=_text(stiffness), springref=_text(rest),
                    damping=_text(problem.retardation_s * stiffness), armature="0",
                )  # fmt: skip
            mass = problem.geometry.mass_per_length_kg_m * length
            across = mass * length**2 / 12.0
            _inertial(body, 0.5 * length, mass, (across, across, min(0.5 * mass * radius**2, across)))
        if grasp is not None:
            # The rounded tip ends where the muscle ends.
            stop = length - radius if index == elements else length
            ElementTree.SubElement(
                body, "geom", type="capsule", size=_text(radius), fromto=_text(0, 0, 0, 0, 0, max(stop, 1e-4)),
                contype=str(_FINGER), conaffinity="0", condim="3", friction=_text(grasp.friction, 0, 0), mass="0",
            )  # fmt: skip
    ElementTree.SubElement(body, "site", name=f"tip_{finger}", pos=_text(0, 0, spans[-1, 1] - spans[-1, 0]))


def _add_sphere(world: ElementTree.Element, grasp: Grasp) -> None:
    body = ElementTree.SubElement(world, "body", name="sphere", pos=_text(0, 0, -grasp.depth_m))
    ElementTree.SubElement(body, "freejoint")
    ElementTree.SubElement(
        body, "geom", type="sphere", size=_text(grasp.radius_m), mass=_text(grasp.mass_kg), contype="0",
        conaffinity=str(_FINGER | _STAND), condim="3", friction=_text(grasp.friction, 0, 0),
    )  # fmt: skip
    half, thick = grasp.stand_half_m, 0.005
    ElementTree.SubElement(
        world, "geom", type="box", size=_text(half, half, thick),
        pos=_text(0, 0, -grasp.depth_m - grasp.radius_m - thick), contype=str(_STAND), conaffinity="0",
    )  # fmt: skip


def _inertial(body: ElementTree.Element, along_m: float, mass_kg: float, inertia: tuple[float, float, float]) -> None:
    ElementTree.SubElement(body, "inertial", pos=_text(0, 0, along_m), mass=_text(mass_kg), diaginertia=_text(*inertia))


def _text(*numbers: float) -> str:
    """Return the numbers with all their digits."""
    return " ".join(repr(float(number)) for number in numbers)


class MujocoFreeBend:
    """MuJoCo with a number of elements, a step and an integrator.

    Raises:
        PeerMissingError: it is not installed.
    """

    def __init__(self, problem: FingerProblem, elements: int, step_s: float, integrator: str) -> None:
        self._mujoco = load_mujoco()
        self._model = self._mujoco.MjModel.from_xml_string(model_xml(problem, elements, step_s, integrator))
        self._data = self._mujoco.MjData(self._model)
        self._step_s = step_s

    def reset(self) -> None:
        """Hang straight, at rest."""
        self._mujoco.mj_resetData(self._model, self._data)

    def advance(self, seconds: float) -> None:
        """Go on, all steps in one Python call."""
        self._mujoco.mj_step(self._model, self._data, nstep=round(seconds / self._step_s))

    def advance_singly(self, seconds: float) -> None:
        """Go on, one Python call a step."""
        step, model, data = self._mujoco.mj_step, self._model, self._data
        for _ in range(round(seconds / self._step_s)):
            step(model, data)

    def tips_m(self) -> Array:
        """Return the tips in ``gripper_base``, shape (4, 3)."""
        self._mujoco.mj_kinematics(self._model, self._data)
        return self._data.site_xpos * (1.0, 1.0, -1.0)


class MujocoGrasp:
    """MuJoCo closing on a sphere and lifting it.

    Raises:
        PeerMissingError: it is not installed.
    """

    def __init__(self, grasp: Grasp, elements: int, step_s: float, integrator: str) -> None:
        self._mujoco = load_mujoco()
        xml = model_xml(grasp.problem, elements, step_s, integrator, grasp)
        self._model = self._mujoco.MjModel.from_xml_string(xml)
        self._data = self._mujoco.MjData(self._model)
        self._step_s, self._grasp = step_s, grasp
        self._lift = self._model.joint("lift").id
        self._height_m, _ = hand_motion(np.arange(round(GRASP_S / step_s) + 1, dtype=np.float64) * step_s)
        self._done = 0

    def reset(self) -> None:
        """Open, hand down."""
        self._mujoco.mj_resetData(self._model, self._data)
        self._done = 0

    def advance(self, seconds: float) -> None:
        """Go on, all steps in one Python call, the hand at its mean speed over them."""
        steps, first = round(seconds / self._step_s), self._height_m[self._done]
        self._done += steps
        self._data.qpos[self._lift] = first
        self._data.qvel[self._lift] = (self._height_m[self._done] - first) / seconds
        self._mujoco.mj_step(self._model, self._data, nstep=steps)

    def rise_m(self) -> float:
        """Return how far the sphere has risen."""
        return float(self._data.body("sphere").xpos[2]) + self._grasp.depth_m


def has_integrator(name: str) -> bool:
    """Whether the installed MuJoCo has an integrator.

    Raises:
        PeerMissingError: MuJoCo is not installed.
    """
    return hasattr(load_mujoco().mjtIntegrator, f"mjINT_{name.upper()}")
