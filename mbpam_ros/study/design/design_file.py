"""Keep a chosen design under a name, so that a gripper file may say ``design: NAME``."""

from __future__ import annotations

import re
from dataclasses import asdict

import numpy as np

from mbpam_ros.actuator.named_designs import INITIAL, KeptDesign, kept_designs_path, load_kept_designs
from mbpam_ros.configuration import ConfigError
from mbpam_ros.study.result_file import write_json


def keep_design(name: str, result: dict, samples: str) -> None:
    """Write the chosen design of ``result`` to the file of kept designs, in place of an older one of that name.

    Args:
        name: of letters, digits and ``_``, letter first.
        result: as of :func:`~mbpam_ros.study.design.optimise_design.result_json`.
        samples: where the metamodel's samples come from.

    Raises:
        ConfigError: a name that cannot be, or that is the paper's initial design's; or the file holds something else.
        DesignDomainError: the paper's data do not speak about the design, so no gripper could run with it.
        ResultFileError: the file cannot be written.
    """
    if name == INITIAL or not re.fullmatch(r"[a-z]\w*", name, re.ASCII | re.IGNORECASE):
        raise ConfigError(
            f"--save-as {name}: {INITIAL} is the paper's design; other names are letters, digits and _, letter first"
        )
    chosen, run = result["chosen"], result["runs"][0]
    kept = KeptDesign(
        a_mm=chosen["a_mm"],
        b_mm=chosen["b_mm"],
        theta_max_deg=chosen["theta_deg"],
        f_max_n=chosen["f_n"],
        provenance={
            "command": "mbpam optimise",
            "samples": samples,
            "metamodel": result["metamodel"],
            "algorithm": run["algorithm"],
            "seed": str(run["seed"]),
            "rule": chosen["rule"],
            "numpy": np.__version__,
        },
    )
    designs = {**load_kept_designs(), name: kept}
    write_json(kept_designs_path(), {"designs": {key: asdict(designs[key]) for key in sorted(designs)}})
