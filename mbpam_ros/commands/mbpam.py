"""Everything of mbpam_ros that is not a node, a verb each. "mbpam VERB --help" tells of one."""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Sequence
from typing import NoReturn, Protocol, cast

from mbpam_ros.commands.interrupt import INTERRUPTED, interrupt_ends_it
from mbpam_ros.commands.verb import Verb
from mbpam_ros.errors import MbpamError

VERBS = (
    Verb("demo", "grasp and lift the paper's objects with six node processes", "demo"),
    Verb("plan", "how to compute a scene within a tolerance, and why", "plan"),
    Verb("trade", "what accuracy costs: measure the table that plans are made from", "trade", resumes=True),
    Verb("judge-planner", "whether plans keep what they promise, on random scenes", "judge_planner", resumes=True),
    Verb("costs", "what each part of a scene costs, and that it costs nothing where it is absent", "costs"),
    Verb("stability", "where the plant's steps are stable", "stability", resumes=True),
    Verb(
        "grasps", "the least pressure that holds each of the paper's objects, and what holds it", "grasps", resumes=True
    ),
    Verb("grip-table", "the least pressure that holds, by size, mass and friction", "grip_table", resumes=True),
    Verb("judge-grips", "pressure by object beside pressure by mode, on random grasps", "judge_grips", resumes=True),
    Verb("judge-holding", "whether held and empty are told rightly, on random grasps", "judge_holding", resumes=True),
    Verb(
        "faults", "faults of the machine at random: who sees them, how soon, what comes of it", "faults", resumes=True
    ),
    Verb("peers", "CPU time at equal accuracy beside MuJoCo and PyElastica", "peers", resumes=True),
    Verb("rod", "one muscle as a rod under loads in any posture, alone or beside finite elements", "rod"),
    Verb("fe", "the finite element muscle: beside the paper's, and the laws made from it", "fe"),
    Verb("silicone", "constants of a silicone from its tensile test", "silicone"),
    Verb("muscle", "your own muscle: from its drawing and the rig's curves to a calibrated gripper", "muscle"),
    Verb("palm", "the housing with four seats for the muscles, to print", "palm"),
    Verb("characterise", "bend and force of one muscle over pressure, on the rig", "characterise"),
    Verb("judge-rig", "whether rig and calibration find hidden muscles", "judge_rig", resumes=True),
    Verb("metamodels", "metamodels of the muscle beside each other and the paper's", "metamodels", resumes=True),
    Verb("sample", "where to run finite elements so that few samples tell most", "sample", resumes=True),
    Verb("optimise", "the designs that bend furthest and press hardest, and a compromise", "optimise", resumes=True),
    Verb("detect", "the objects in an image file: shape, size and place", "detect"),
    Verb("judge-detector", "how well objects are detected, on images drawn by MuJoCo and our own", "judge_detector"),
    Verb("view", "watch a gripper in a browser", "view"),
    Verb("record", "record all topics of a gripper as MCAP", "record"),
    Verb("replay", "let nodes live through a recording again", "replay"),
    Verb("report", "the picture report of a grasp, from a recording", "report"),
    Verb("urdf", "the gripper as a URDF, with meshes if asked for", "urdf"),
    Verb("compile", "compile all kernels ahead, so that no node does it when it starts", "compile"),
    Verb("bench", "CPU and latency of the running nodes, beside their budgets", "bench"),
    Verb("soak", "the gripper under random use, faults and repairs for a long time: what leaks, what is late", "soak"),
    Verb("first-grasps", "how long the valves are left alone in the first grasp after a start", "first_grasps"),
)

EXTRAS = {
    "rclpy": "ros",
    "domain_coordinator": "ros",
    "psutil": "bench",
    "mujoco": "bench",
    "felupe": "fem",
    "manifold3d": "cad",
    "mcap": "record",
    "viser": "view",
}
"""Which extra of the package installs what a verb may miss."""

_RAW = argparse.RawDescriptionHelpFormatter


class VerbModule(Protocol):
    """What the module of a verb has."""

    __doc__: str

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Add the verb's arguments."""

    def run(self, options: argparse.Namespace) -> int:
        """Do it; return the exit status."""


class OneLineParser(argparse.ArgumentParser):
    """Says in one line what is wrong with arguments, and where help is."""

    def error(self, message: str) -> NoReturn:
        """Print the line and exit with 2."""
        self.exit(2, f"{self.prog}: {message}; see {self.prog} --help\n")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one verb.

    Returns:
        Exit status: 0, 1 if it failed or its result is not good, 2 for arguments that cannot be, 130 on Ctrl-C. What
        went wrong goes to standard error as one line.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    program = "mbpam"
    keeps = False
    description: str | None = __doc__
    try:
        verbs: Sequence[Verb] = VERBS
        while True:
            verb = _chosen(program, description, verbs, given[:1])
            program, given = f"{program} {verb.name}", given[1:]
            with interrupt_ends_it(program):
                module = importlib.import_module(f"mbpam_ros.commands.{verb.module}")
            if not hasattr(module, "VERBS"):
                break
            verbs, description = module.VERBS, module.__doc__
        options = _options(cast(VerbModule, module), program, given)
        keeps = verb.resumes and getattr(options, "json", True) is not None  # some have a folder of their own
        return cast(VerbModule, module).run(options)
    except KeyboardInterrupt:
        kept = "; what is finished is kept, the same command goes on from it" if keeps else ""
        print(f"\n{program}: interrupted{kept}", file=sys.stderr)
        return INTERRUPTED
    except MbpamError as error:
        print(f"{program}: {error}", file=sys.stderr)
        return 1
    except ModuleNotFoundError as error:
        if error.name not in EXTRAS:
            raise
        print(f"{program}: {error}; pip install 'mbpam_ros[{EXTRAS[error.name]}]'", file=sys.stderr)
        return 1


def _chosen(program: str, description: str | None, verbs: Sequence[Verb], arguments: Sequence[str]) -> Verb:
    parser = OneLineParser(program, description=description, formatter_class=_RAW)
    choices = parser.add_subparsers(dest="verb", metavar="VERB", title="verbs", required=True)
    for verb in verbs:
        choices.add_parser(verb.name, help=verb.summary, add_help=False)
    name = parser.parse_args([each.replace("_", "-") for each in arguments]).verb
    return next(verb for verb in verbs if verb.name == name)


def _options(module: VerbModule, program: str, arguments: Sequence[str]) -> argparse.Namespace:
    parser = OneLineParser(program, description=module.__doc__, formatter_class=_RAW)
    module.add_arguments(parser)
    return parser.parse_args(arguments)
