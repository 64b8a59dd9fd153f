"""What each part of a scene costs, and that it costs nothing where it is absent.

Scenes that differ from a bare one (four muscles in the air that do not meet, two modes, 2 ms, lag) in one thing each.
CPU times are the medians of several runs of the plant's steps at 100 Hz, and of the images where there is a camera; the
bare scene is run before and after, and the difference is what a figure is worth. What is absent is not even imported:
the last column. The last two scenes show what fewer modes save while an object is out of reach
(:mod:`~mbpam_ros.plant.stepping`).
"""

from __future__ import annotations

import dataclasses
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mbpam_ros.actuator.chambers import CHAMBERS_PER_FINGER
from mbpam_ros.configuration import ConfigError
from mbpam_ros.grasp.modes import load_modes
from mbpam_ros.gripper import Gripper
from mbpam_ros.plant.plant import Observation, build_plant
from mbpam_ros.plant.scene import ALL_FINGERS, Scene, load_scene
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
    "rod": "mbpam_ros.plant.moving",
    "static": "mbpam_ros.plant.static",
    "iso6358": "mbpam_ros.pneumatics.iso6358",
    "camera": "mbpam_ros.vision.render",
}


@dataclass(frozen=True)
class Variant:
    """A scene that differs from the bare one in one thing.

    Args:
        what: that thing.
        scene: to be run.
        lift: whether the hand rises.
        camera: whether five images a second are rendered, of the fingers.
    """

    what: str
    scene: Scene
    lift: bool = False
    camera: bool = False


def variants() -> tuple[Variant, ...]:
    """Return the bare scene and those that differ from it in one thing each.

    Raises:
        ConfigError: a scene cannot be read.
    """
    bare, bulb = load_scene("empty"), load_scene("bulb")

    def changed(scene: Scene, **values: Any) -> Scene:
        own: dict[str, Any] = {
            "tier": "rod",
            "modes": 2,
            "sub_step_s": 0.002,
            "pneumatics": "lag",
            "fingers_touch": False,
            **values,
        }
        return dataclasses.replace(scene, config=dataclasses.replace(scene.config, **own))

    if bulb.config.support is None:
        raise ConfigError("scene bulb: no support to lower")
    far: dict[str, Any] = {
        "object_position_m": (0.0, 0.0, 0.47),
        "support": dataclasses.replace(bulb.config.support, depth_m=0.5),
    }
    fine: dict[str, Any] = {"modes": 5, "sub_step_s": 0.0005}
    return (
        Variant("bare", changed(bare)),
        Variant("lift", changed(bare), lift=True),
        Variant("two fingers", changed(bare, moving_fingers=(1, 3))),
        Variant("fingers that touch", changed(bare, fingers_touch=True)),
        Variant("one mode more", changed(bare, modes=3)),
        Variant("iso6358", changed(bare, pneumatics="iso6358")),
        Variant("camera", changed(bare), camera=True),
        Variant("object out of reach", changed(bulb, **far)),
        Variant("object in the grasp", changed(bulb)),
        Variant("and two fingers", changed(bulb, moving_fingers=(1, 3))),
        Variant("static, ideal", changed(bare, tier="static", modes=None, pneumatics="ideal")),
        Variant("bare, again", changed(bare)),
        Variant("far, 5 modes, 0.5 ms", changed(bulb, **far, **fine)),
        Variant("the same, 2 in the air", changed(bulb, **far, **fine, air_modes=2)),
    )


def cpu_ms_per_s(variant: Variant, gripper: Gripper) -> float:
    """Return the CPU time of one simulated second, images included, without observing."""
    plant = build_plant(variant.scene, gripper)
    renderer = Renderer.from_config(load_camera_config()) if variant.camera else None
    moving = np.isin(ALL_FINGERS, variant.scene.config.moving_fingers or ALL_FINGERS)
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


def imported_parts(scene: Scene) -> tuple[str, ...]:
    """Return which of the heavy parts a new process imports to build and step the plant of a scene."""
    config = scene.config
    code = (
        "import dataclasses, sys, numpy\n"
        "from mbpam_ros.gripper import load_gripper\n"
        "from mbpam_ros.plant.plant import build_plant\n"
        "from mbpam_ros.plant.scene import load_scene\n"
        f"scene = load_scene({'empty' if scene.object is None else 'bulb'!r})\n"
        f"config = dataclasses.replace(scene.config, tier={config.tier!r}, modes={config.modes!r}, "
        f"sub_step_s={config.sub_step_s!r}, pneumatics={config.pneumatics!r})\n"
        "build_plant(dataclasses.replace(scene, config=config), load_gripper()).step(numpy.zeros(16), 0.01)\n"
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
        names = (*imported_parts(variant.scene), *(("camera",) if variant.camera else ()))
        cost = costs[variant.what]
        rows.append((variant.what, f"{cost:.1f}", f"{cost - costs['bare']:+.1f}", ", ".join(names)))
    return table(("differs in", "CPU [ms/s]", "over bare", "imported"), rows)


def _view(seen: Observation, gripper: Gripper) -> SceneView:
    return SceneView(
        support_depth_m=_FLOOR_M,
        finger_centrelines_m=seen.centreline_m,
        finger_radius_m=gripper.geometry.outer_radius_m,
    )
