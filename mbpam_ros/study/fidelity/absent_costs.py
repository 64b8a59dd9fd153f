"""What each part of a scene costs, and that it costs nothing where it is absent.

Scenes that differ from a bare one (four muscles in the air that do not meet, two modes, 2 ms, lag) in one thing each.
CPU times are the medians of several runs of the plant's steps at 100 Hz, and of the images where there is a camera; the
bare scene is run before and after, and the difference is what a figure is worth. What is absent is not even imported:
the last column. The last two scenes show what fewer modes save while an object is out of reach
(:mod:`~mbpam_ros.plant.tiers.adaptive`).
"""

from __future__ import annotations

import dataclasses
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mbpam_ros.actuator.chambers import CHAMBERS_PER_FINGER
from mbpam_ros.configuration import ConfigError
from mbpam_ros.grasp.modes import load_modes
from mbpam_ros.gripper import Gripper
from mbpam_ros.plant.fidelity import ALL_FINGERS, Fidelity
from mbpam_ros.plant.plant import Observation, build_plant
from mbpam_ros.plant.scene import Scene, load_scene
from mbpam_ros.study.fidelity.runs import TICK_S, proportional_spool
from mbpam_ros.terminal import table
from mbpam_ros.vision.camera import load_camera_config
from mbpam_ros.vision.render import Renderer, SceneView

REPEATS = 5
_DURATION_S, _IMAGE_EVERY = 1.5, 20
_FLOOR_M = 0.5
S_PER_RUN = 0.3
"""CPU of a scene [s], once."""
_HEAVY_MODULES = {
    "rod": "mbpam_ros.plant.tiers.rod",
    "static": "mbpam_ros.plant.tiers.static",
    "iso6358": "mbpam_ros.pneumatics.iso6358",
    "camera": "mbpam_ros.vision.render",
}


@dataclass(frozen=True)
class Variant:
    """A scene that differs from the bare one in one thing.

    Args:
        what: that thing.
        scene, fidelity: to be run.
        lift: whether the hand rises.
        camera: whether five images a second are rendered, of the fingers.
    """

    what: str
    scene: Scene
    fidelity: Fidelity
    lift: bool = False
    camera: bool = False


def variants() -> tuple[Variant, ...]:
    """Return the bare scene and those that differ from it in one thing each.

    Raises:
        ConfigError: a scene cannot be read.
    """
    empty, bulb = (dataclasses.replace(load_scene(name)[0], fingers_touch=False) for name in ("empty", "bulb"))
    if bulb.support is None:
        raise ConfigError("scene bulb: no support to lower")
    deep = dataclasses.replace(bulb.support, depth_m=0.5)
    far = dataclasses.replace(bulb, object_position_m=(0.0, 0.0, 0.47), support=deep)
    plain = Fidelity("rod", 2, 0.002, "lag")
    two_fingers = dataclasses.replace(plain, moving_fingers=(1, 3))
    fine = Fidelity("rod", 5, 0.0005, "lag")
    return (
        Variant("bare", empty, plain),
        Variant("lift", empty, plain, lift=True),
        Variant("two fingers", empty, two_fingers),
        Variant("fingers that touch", dataclasses.replace(empty, fingers_touch=True), plain),
        Variant("one mode more", empty, dataclasses.replace(plain, modes=3)),
        Variant("iso6358", empty, dataclasses.replace(plain, pneumatics="iso6358")),
        Variant("camera", empty, plain, camera=True),
        Variant("object out of reach", far, plain),
        Variant("object in the grasp", bulb, plain),
        Variant("and two fingers", bulb, two_fingers),
        Variant("static, ideal", empty, Fidelity("static", 1, 0.002, "ideal")),
        Variant("bare, again", empty, plain),
        Variant("far, 5 modes, 0.5 ms", far, fine),
        Variant("the same, 2 in the air", far, dataclasses.replace(fine, air_modes=2)),
    )


def cpu_ms_per_s(variant: Variant, gripper: Gripper) -> float:
    """Return the CPU time of one simulated second, images included, without observing."""
    plant = build_plant(variant.scene, variant.fidelity, gripper)
    renderer = Renderer.from_config(load_camera_config()) if variant.camera else None
    moving = np.isin(ALL_FINGERS, variant.fidelity.moving_fingers)
    target = load_modes()["envelope"].setpoints(80e3) * np.repeat(moving, CHAMBERS_PER_FINGER)
    if variant.lift:
        plant.lift()
    spent_s = 0.0
    for tick in range(round(_DURATION_S / TICK_S)):
        seen = plant.observe()
        begun_s = time.process_time()
        plant.step(proportional_spool(target, seen.pressure_gauge_pa), TICK_S)
        if renderer is not None and tick % _IMAGE_EVERY == 0:
            renderer.render(_view(seen, gripper))
        spent_s += time.process_time() - begun_s
    return 1e3 * spent_s / _DURATION_S


def imported_parts(scene: Scene, fidelity: Fidelity) -> tuple[str, ...]:
    """Return which of the heavy parts a new process imports to build and step the plant of a scene."""
    code = (
        "import sys, numpy\n"
        "from mbpam_ros.gripper import load_gripper\n"
        "from mbpam_ros.plant.fidelity import Fidelity\n"
        "from mbpam_ros.plant.plant import build_plant\n"
        "from mbpam_ros.plant.scene import load_scene\n"
        f"scene, _ = load_scene({'empty' if scene.object is None else 'bulb'!r})\n"
        f"build_plant(scene, {fidelity!r}, load_gripper()).step(numpy.zeros(16), 0.01)\n"
        f"print(*(name for name, module in {_HEAVY_MODULES!r}.items() if module in sys.modules))\n"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return tuple(ended.stdout.split())


def measured_costs(found: Sequence[Variant], gripper: Gripper, turn_ended: Callable[[str], object]) -> dict[str, float]:
    """Return the CPU times [ms per simulated s] by what differs: medians of several turns through all scenes.

    ``turn_ended`` is called after each turn with a line about it.
    """
    costs: dict[str, list[float]] = {variant.what: [] for variant in found}
    for turn in range(1 + REPEATS):  # in turn, so that a busy machine is busy for all; the first compiles
        for variant in found:
            costs[variant.what].append(cpu_ms_per_s(variant, gripper))
        turn_ended("all scenes once more" if turn else "all scenes once, to compile")
    return {what: statistics.median(values[1:]) for what, values in costs.items()}


def costs_text(found: Sequence[Variant], costs: Mapping[str, float]) -> str:
    """Return the table of costs, with what a process imports for each scene."""
    rows = []
    for variant in found:
        names = (*imported_parts(variant.scene, variant.fidelity), *(("camera",) if variant.camera else ()))
        cost = costs[variant.what]
        rows.append((variant.what, f"{cost:.1f}", f"{cost - costs['bare']:+.1f}", ", ".join(names)))
    return table(("differs in", "CPU [ms/s]", "over bare", "imported"), rows)


def _view(seen: Observation, gripper: Gripper) -> SceneView:
    return SceneView(
        support_depth_m=_FLOOR_M,
        finger_centrelines_m=seen.centreline_m,
        finger_radius_m=gripper.geometry.outer_radius_m,
    )
