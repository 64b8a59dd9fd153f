import ast
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from mbpam_ros.actuator.metamodel import PolynomialResponseSurface
from mbpam_ros.study.design import pictures
from mbpam_ros.study.design.accuracy import Coverage
from mbpam_ros.study.design.comparison import judge
from mbpam_ros.study.design.pareto import grid_front
from mbpam_ros.study.design.pictures import (
    draw_comparison,
    draw_optimisation,
    draw_sampling,
    draw_uncertainty,
)
from mbpam_ros.study.design.responses import published_responses
from mbpam_ros.study.design.samples import Samples
from mbpam_ros.study.design.uncertainty import UncertaintyMap
from mbpam_ros.study.pictures import PictureError

SAMPLES = Samples.of_the_paper("doe_training.csv")


def assert_drawn(path):
    image = cv2.imread(str(path))
    assert image is not None and min(image.shape[:2]) > 300
    drawn = np.ptp(image.astype(int), axis=2) > 40  # coloured, which neither paper nor axes are
    assert drawn.mean() > 1e-3


def test_each_picture_is_drawn(tmp_path):
    pytest.importorskip("matplotlib")
    draw_sampling(SAMPLES.design_mm, ("a_mm", "b_mm"), SAMPLES.design_mm, tmp_path / "sampling.png")
    assert_drawn(tmp_path / "sampling.png")
    draw_comparison({"PRS": judge(PolynomialResponseSurface, SAMPLES, SAMPLES)}, SAMPLES, tmp_path / "new" / "c.png")
    assert_drawn(tmp_path / "new" / "c.png")
    responses = published_responses()
    front = grid_front(responses.objectives, responses.domain, 41)
    point = {"a_mm": 2.0, "b_mm": 1.5, "theta_deg": 130.0, "f_n": 0.7}
    result = {"metamodel": "published", "initial": None, "chosen": point}
    draw_optimisation(responses, front, {"mopso": front}, result, tmp_path / "front.png")
    assert_drawn(tmp_path / "front.png")
    axis = np.linspace(1.5, 3.5, 5)
    sigma = np.add.outer(axis, axis)
    errors = np.linspace(-1.0, 1.0, 21)
    coverage = Coverage.of(errors, np.ones(21), "left out")
    uncertainty = UncertaintyMap(
        axis,
        axis - 0.5,
        {"theta_max": sigma, "f_max": sigma},
        {"theta_max": errors, "f_max": errors},
        {"theta_max": coverage, "f_max": coverage},
    )
    draw_uncertainty(uncertainty, SAMPLES, tmp_path / "map.png")
    assert_drawn(tmp_path / "map.png")


def test_a_picture_that_cannot_be_written_says_why(tmp_path):
    pytest.importorskip("matplotlib")
    with pytest.raises(PictureError, match="cannot write .*picture.doc"):
        draw_sampling(SAMPLES.design_mm, ("a_mm", "b_mm"), SAMPLES.design_mm, tmp_path / "picture.doc")


def test_without_matplotlib_a_picture_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(PictureError, match=r"mbpam_ros\[report\]"):
        draw_sampling(SAMPLES.design_mm, ("a_mm", "b_mm"), SAMPLES.design_mm, tmp_path / "picture.png")


def test_what_is_optional_is_imported_only_where_it_is_used():
    for path in Path(pictures.__file__).parent.glob("*.py"):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module] if isinstance(node, ast.ImportFrom) else []
            assert not [name for name in names if name.startswith(("matplotlib", "pymoo"))], path
