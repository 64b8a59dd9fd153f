"""Random grasps with noise, and what air and camera tell of them: held, empty or unknown.

Of the grasps (:mod:`~mbpam_ros.study.grasp.drawn_grasps`) two in five close with the grip of the arbiter, one in five
with less, so that many of them lose the object, and two in five upon an object that was seen and then taken away. After
the lift the camera looks once. The valves' flows differ from what the account of the air takes them for, each by its
own factor, and supply and line volumes by one each; the transducers have their noise, the images theirs.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.actuator.chambers import CHANNEL_COUNT
from mbpam_ros.grasp.air_bend import AirBend
from mbpam_ros.grasp.arbitration import GraspConfig, Phase
from mbpam_ros.grasp.empty_hand import EmptyHand
from mbpam_ros.grasp.holding_watch import HoldingWatch
from mbpam_ros.grasp.selection import DetectedObject
from mbpam_ros.gripper import Gripper
from mbpam_ros.plant.fidelity import FidelityRequest
from mbpam_ros.plant.plant import Observation
from mbpam_ros.plant.scene import Scene
from mbpam_ros.plant.tiers.base import PlantDivergedError
from mbpam_ros.pneumatics.chamber import AMBIENT_PA
from mbpam_ros.pneumatics.config import PneumaticsConfig, load_pneumatics
from mbpam_ros.simulation import TICK_S, Simulation
from mbpam_ros.study.grasp.drawn_grasps import drawn_grasp
from mbpam_ros.study.grasp.trial import HELD_SHARE
from mbpam_ros.vision.camera import camera_intrinsics, camera_pose, load_camera_config
from mbpam_ros.vision.detector import ObjectDetector, load_detector_config
from mbpam_ros.vision.render import ColouredSolid, Renderer, SceneView

CASES, SHARES = ("gripped", "weakly gripped", "taken away"), (0.4, 0.2, 0.4)
WEAK_PA = (56e3, 85e3)

VALVE_SIGMA = 0.01
"""Of a valve's flow, after a calibration, over what it is taken for."""

SUPPLY_SIGMA, LINE_SIGMA = 0.003, 0.02
"""Likewise of the supply's pressure (absolute) and of all lines' volume."""

S_PER_GRASP = 1.0
"""CPU of a grasp, a guess."""

_REST_S, _STAY_S = 0.3, 0.5


class _FeltSimulation(Simulation):
    """A simulation whose valves err, with a watch that is told what they are commanded."""

    watch: HoldingWatch | None = None
    gain: NDArray[np.float64] | float = 1.0

    def _moved(self, spool: NDArray[np.float64]) -> NDArray[np.float64]:
        if self.watch is not None:
            self.watch.valves(self.seen.time_s, spool)
        return np.clip(self.gain * spool, -1.0, 1.0)


def felt_row(
    name: str,
    seed: int,
    number: int,
    valve_sigma: float,
    request: FidelityRequest,
    gripper: Gripper,
    config: GraspConfig,
    empty: EmptyHand,
) -> dict[str, object]:
    """Return one grasp: what became of it, and what each sense found, as plain values.

    Raises:
        ConfigError, TierError: a file is wrong, or the tier cannot compute the scene.
    """
    rng = np.random.default_rng([seed, number, 1])
    drawn = drawn_grasp(seed, number, gripper, config.grip)
    case = str(rng.choice(CASES, p=SHARES))
    weak_pa = float(rng.uniform(*WEAK_PA))
    assumed = replace(load_pneumatics(), model="iso6358")
    there = drawn.scene if case != "taken away" else replace(drawn.scene, object=None, object_position_m=None)
    simulation = _FeltSimulation(
        there,
        replace(request, pneumatics="iso6358"),
        gripper,
        weak_pa if case == "weakly gripped" else None,
        seed=int(rng.integers(2**31)),
        real_pneumatics=_erring(assumed, rng),
    )
    simulation.gain = 1.0 + valve_sigma * rng.standard_normal(CHANNEL_COUNT)
    eye = _Eye(drawn.scene, gripper, rng)
    simulation.run(_REST_S)
    before = _FeltSimulation(drawn.scene, request, gripper).seen if case == "taken away" else simulation.seen
    target = _nearest(eye.look(before), drawn.scene)
    watch = HoldingWatch(config.holding, AirBend(gripper, assumed.chamber), empty)
    row: dict[str, object] = {"job": name, "mode": drawn.mode, "case": case, "seen": target is not None}
    try:
        simulation.grasp(drawn.mode)
        decision = simulation.decision
        watch.begin(
            simulation.seen.time_s,
            simulation.seen.pressure_gauge_pa,
            decision.setpoint_gauge_pa,
            (drawn.mode, decision.quarter_turns, decision.mirrored),
            target,
        )
        simulation.watch = watch
        simulation.run_until(lambda: simulation.decision.phase is not Phase.CLOSING)
        simulation.lift()
        seen = simulation.run(round((drawn.scene.lift.duration_s + _STAY_S) / TICK_S) * TICK_S)
    except PlantDivergedError as error:
        return row | {"held": None, "note": str(error)}
    shortfall_deg = watch.shortfall_deg(simulation.pressure_gauge_pa)
    return row | {
        "held": _held(seen, drawn.scene),
        "shortfall_deg": None if math.isnan(shortfall_deg) else shortfall_deg,
        "size_ratio": None if target is None else watch.size_ratio(eye.look(seen)),
        "note": "",
    }


def _erring(assumed: PneumaticsConfig, rng: np.random.Generator) -> PneumaticsConfig:
    chamber, iso = assumed.chamber, assumed.chamber.iso6358
    supply, line = SUPPLY_SIGMA * rng.standard_normal(), LINE_SIGMA * rng.standard_normal()
    supply_pa = chamber.supply_gauge_pa + supply * (chamber.supply_gauge_pa + AMBIENT_PA)
    iso = replace(iso, line_volume_m3=iso.line_volume_m3 * (1.0 + line))
    return replace(assumed, chamber=replace(chamber, supply_gauge_pa=supply_pa, iso6358=iso))


def _held(seen: Observation, scene: Scene) -> bool:
    """Whether the object has risen with the hand."""
    if seen.object_in_world is None or scene.object_position_m is None:
        return False
    rise_m = scene.object_position_m[2] - seen.object_in_world.position_m[2]
    return bool(rise_m >= HELD_SHARE * scene.lift.height_m)


class _Eye:
    """The palm camera: renders what is there, and detects."""

    def __init__(self, scene: Scene, gripper: Gripper, rng: np.random.Generator) -> None:
        camera = load_camera_config()
        self._scene, self._radius_m, self._rng = scene, gripper.geometry.outer_radius_m, rng
        self._renderer, self._intrinsics = Renderer.from_config(camera), camera_intrinsics(camera)
        self._detector = ObjectDetector(load_detector_config(), camera_pose(camera), gripper)
        red, green, blue = rng.uniform(0.15, 0.9, 3)
        self._colour = float(red), float(green), float(blue)

    def look(self, seen: Observation) -> list[DetectedObject]:
        support, spec, body = self._scene.support, self._scene.object, seen.object_in_gripper
        assert support is not None and spec is not None and support.stand_height_m is not None
        depth_m = support.depth_m + seen.hand_lift_m
        solids: tuple[ColouredSolid, ...] = ()
        if body is not None:
            solids = (
                ColouredSolid(spec.shape, np.array(spec.size_m), body.position_m, body.orientation_xyzw, self._colour),
            )
        view = SceneView(
            support_depth_m=depth_m,
            solids=solids,
            finger_centrelines_m=seen.centreline_m,
            finger_radius_m=self._radius_m,
            support_half_size_m=support.half_size_m,
            floor_depth_m=depth_m + support.stand_height_m,
        )
        image = self._renderer.render(view, self._rng)
        # The depth of the support is what the node was told before the lift.
        found = self._detector.detect(image, "rgb8", self._intrinsics, None, support.depth_m)
        return [
            DetectedObject(
                each.label,
                each.shape,
                tuple(each.size_m),
                tuple(each.position_m),
                tuple(each.orientation_xyzw),
                float(min(each.confidence, 1.0)),
            )
            for each in found
        ]


def _nearest(seen: Sequence[DetectedObject], scene: Scene) -> DetectedObject | None:
    """The detection of the drawn object, if there is one where it is."""
    assert scene.object_position_m is not None
    x, y, _ = scene.object_position_m
    near = [each for each in seen if math.hypot(each.position_m[0] - x, each.position_m[1] - y) < 0.03]
    return min(near, key=lambda each: math.hypot(each.position_m[0] - x, each.position_m[1] - y), default=None)
