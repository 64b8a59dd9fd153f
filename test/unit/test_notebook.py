"""The notebook runs from its first cell to its last, and shows what its text says.

Its cells are run as plain Python: a Jupyter kernel would add a dozen packages and ten seconds to find out the same.
"""

import json
from pathlib import Path

import numpy as np
import pytest

NOTEBOOK = Path(__file__).parents[2] / "examples" / "first_grasp.ipynb"


@pytest.mark.slow
def test_the_first_grasp_holds_and_the_curves_bend_as_the_text_says(capsys, monkeypatch):
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    from matplotlib import pyplot

    drawn = []
    monkeypatch.setattr(pyplot, "show", lambda: (drawn.append(len(pyplot.gca().lines)), pyplot.close("all")))
    content = json.loads(NOTEBOOK.read_text(encoding="utf-8"))
    cells = [cell for cell in content["cells"] if cell["cell_type"] == "code"]
    assert (content["nbformat"], {tuple(cell["outputs"]) for cell in cells}) == (
        4,
        {()},
    )  # none is kept
    names = {"__name__": "notebook"}
    for number, cell in enumerate(cells, 1):
        exec(compile("".join(cell["source"]), f"{NOTEBOOK.name}, cell {number}", "exec"), names)
    assert drawn == [16, 2, 3]
    assert names["rise_m"] == pytest.approx(0.1, abs=2e-3) and "closing in envelope" in capsys.readouterr().out
    psc, pdc = names["curves"]["PSC"], names["curves"]["PDC"]
    assert (np.diff(psc) > 0.0).all() and (pdc[1:] > psc[1:]).all() and pdc[-1] > 100.0
    thick, initial, deep = (names["greatest_deg"][name] for name in ("thicker cross", "initial", "deeper wave"))
    assert thick < initial < deep
