"""The peers' problem in MuJoCo: a chain of rigid links with two hinges an element.

The active part is cut into N elements of length l = L / N. Both hinges of an element stand in its middle and carry its
bending: stiffness B / l, damping eta B / l, and a rest angle that makes the moment M0. The axis of one is normal to the
plane of the muscle's moment, so that a plane bend is one of these alone. Links are slender rods, as ours are; MuJoCo
needs an inertia about their axes too, which plays no part in a plane bend. Armature is 0.

With all strains every moving link also has a hinge along itself, stiffness GJ / d, and a slide along itself; d is l,
l / 2 for the last one, and 3 l / 2 for the first: it does the share of the clamped one too, on whose joints there would
be no mass of their own. The slide's spring is a fixed tendon of stiffness EA / d that rests at epsilon_0 d, of length x
less c times the bends at the link's ends, half of each: the energy of the law. Dampings are eta times the stiffnesses.
Twist and stretch so lie between the bends, and of two hinges the first is the other one from element to element:
positions are of second order in l. A link slides as a whole though its middle goes half as far; its mass stands where
it belongs at the free stretch. No body of MuJoCo resists turning about an axis by more than about the other two
together: short links have less inertia about themselves than the muscle's disc has.
"""

from __future__ import annotations

from types import ModuleType
from xml.etree import ElementTree

import numpy as np

from mbpam_ros.study.peers.grasp import GRASP_S, Grasp, hand_motion
from mbpam_ros.study.peers.problem import Array, FingerProblem, PeerMissingError, Strains

CONE, IMPRATIO, TOLERANCE = "elliptic", 10.0, 1e-8
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


def model_xml(
    problem: FingerProblem, elements: int, step_s: float, integrator: str, grasp: Grasp | None = None,
    cone: str = CONE, tolerance: float = TOLERANCE,
) -> str:  # fmt: skip
    """Return the model as MJCF, world z up; without a grasp nothing touches and the hand stands still."""
    root = ElementTree.Element("mujoco")
    ElementTree.SubElement(root, "compiler", angle="radian")
    options = {
        "timestep": _text(step_s), "integrator": integrator, "cone": cone, "impratio": _text(IMPRATIO),
        "tolerance": _text(tolerance),
        "gravity": _text(*problem.gravity_m_s2[:2], -problem.gravity_m_s2[2]),
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
    if problem.strains is not None:
        tendons = ElementTree.SubElement(root, "tendon")
        for finger in range(len(problem.base_m)):
            _add_stretch_springs(tendons, problem, problem.strains, elements, finger)
    return ElementTree.tostring(root, encoding="unicode")


def strained_lengths(problem: FingerProblem, elements: int) -> Array:
    """Return over what length the N moving links twist and stretch, shape (N,) [m]; the first one for the clamped too.

    A clamped link with joints of its own would have no mass to move.
    """
    lengths = np.full(elements, problem.geometry.active_length_m / elements)
    lengths[-1] *= 0.5
    lengths[0] += 0.5 * problem.geometry.active_length_m / elements
    return lengths


def _add_finger(
    palm: ElementTree.Element, problem: FingerProblem, elements: int, finger: int, grasp: Grasp | None
) -> None:
    spans, radius, strains = link_spans(problem, elements), problem.geometry.outer_radius_m, problem.strains
    strained = strained_lengths(problem, elements)
    stiffness = problem.stiffness_n_m2 * elements / problem.geometry.active_length_m
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
            hinges = [("bend", "0 1 0", problem.moment_n_m / stiffness), ("aside", "1 0 0", 0.0)]
            for name, axis, rest in hinges if strains is None or index % 2 else reversed(hinges):
                ElementTree.SubElement(
                    body, "joint", name=f"{name}_{finger}_{index}", type="hinge", axis=axis, stiffness=_text(stiffness),
                    springref=_text(rest), damping=_text(problem.retardation_s * stiffness), armature="0",
                )  # fmt: skip
            mass, middle = problem.geometry.mass_per_length_kg_m * length, 0.5 * length
            across = mass * length**2 / 12.0
            if strains is not None:
                _add_twist_and_slide(body, problem, strains, f"{finger}_{index}", strained[index - 1])
                active = min(end, problem.geometry.end_length_m + problem.geometry.active_length_m) - start
                middle -= 0.5 * _free_stretch(problem, strains) * active**2 / length
            _inertial(body, middle, mass, (across, across, min(0.5 * mass * radius**2, 2.0 * across)))
        if grasp is not None:
            # The rounded tip ends where the muscle ends.
            stop = length - radius if index == elements else length
            ElementTree.SubElement(
                body, "geom", type="capsule", size=_text(radius), fromto=_text(0, 0, 0, 0, 0, max(stop, 1e-4)),
                contype=str(_FINGER), conaffinity="0", condim="3", friction=_text(grasp.friction, 0, 0), mass="0",
            )  # fmt: skip
    ElementTree.SubElement(body, "site", name=f"tip_{finger}", pos=_text(0, 0, spans[-1, 1] - spans[-1, 0]))


def _free_stretch(problem: FingerProblem, strains: Strains) -> float:
    """Stretch - 1 of a muscle without loads."""
    return strains.free_stretch + strains.slope_m * problem.moment_n_m / problem.stiffness_n_m2


def _add_twist_and_slide(
    body: ElementTree.Element, problem: FingerProblem, strains: Strains, link: str, active_m: float
) -> None:
    stiffness = strains.torsion_stiffness_n_m2 / active_m
    ElementTree.SubElement(
        body, "joint", name=f"twist_{link}", type="hinge", axis="0 0 1", stiffness=_text(stiffness),
        damping=_text(problem.retardation_s * stiffness), armature="0",
    )  # fmt: skip
    ElementTree.SubElement(body, "joint", name=f"slide_{link}", type="slide", axis="0 0 1", armature="0")


def _add_stretch_springs(
    tendons: ElementTree.Element, problem: FingerProblem, strains: Strains, elements: int, finger: int
) -> None:
    for link, length in enumerate(strained_lengths(problem, elements), 1):
        stiffness = strains.axial_stiffness_n / length
        tendon = ElementTree.SubElement(
            tendons, "fixed", stiffness=_text(stiffness), damping=_text(problem.retardation_s * stiffness),
            springlength=_text(strains.free_stretch * length),
        )  # fmt: skip
        ElementTree.SubElement(tendon, "joint", joint=f"slide_{finger}_{link}", coef="1")
        for index, share in ((link, 1.0 if link == 1 else 0.5), (link + 1, 0.5)):
            if index <= elements:
                ElementTree.SubElement(
                    tendon, "joint", joint=f"bend_{finger}_{index}", coef=_text(-share * strains.slope_m)
                )


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
    """MuJoCo closing on a sphere and lifting it, with a cone of friction and a tolerance of its solver.

    Raises:
        PeerMissingError: it is not installed.
    """

    def __init__(
        self, grasp: Grasp, elements: int, step_s: float, integrator: str, cone: str = CONE,
        tolerance: float = TOLERANCE,
    ) -> None:  # fmt: skip
        self._mujoco = load_mujoco()
        xml = model_xml(grasp.problem, elements, step_s, integrator, grasp, cone, tolerance)
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

    def places_m(self) -> Array:
        """Return the tips and the sphere's centre, world frame with z down, shape (5, 3)."""
        self._mujoco.mj_kinematics(self._model, self._data)
        return np.vstack([self._data.site_xpos, self._data.body("sphere").xpos]) * (1.0, 1.0, -1.0)


def has_integrator(name: str) -> bool:
    """Whether the installed MuJoCo has an integrator.

    Raises:
        PeerMissingError: MuJoCo is not installed.
    """
    return hasattr(load_mujoco().mjtIntegrator, f"mjINT_{name.upper()}")
