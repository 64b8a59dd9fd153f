"""How often detections of a confidence are right, drawn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from mbpam_ros.study.pictures import new_figure, save_figure


def draw_reliability(rows: Mapping[str, Sequence[Mapping[str, float]]], path: Path) -> None:
    """Draw the share that is right over the mean confidence of each bin, one panel a set of images.

    Bars are as wide as the bins and as dark as they are full; on the diagonal a confidence is what it says.

    Args:
        rows: for each set its bins, from :func:`~mbpam_ros.study.judge.score.reliability`.
        path: of the picture.

    Raises:
        PictureError: matplotlib is not installed, or the file cannot be written.
    """
    columns = min(len(rows), 3)
    lines = -(-len(rows) // columns)
    figure = new_figure(2.6 * columns, 2.6 * lines)
    for place, (name, bins) in enumerate(rows.items(), 1):
        axes = figure.add_subplot(lines, columns, place)
        most = max((item["count"] for item in bins), default=1.0)
        for item in bins:
            shade = 0.25 + 0.75 * item["count"] / most
            axes.bar(item["from"], item["right"], item["to"] - item["from"], align="edge", color=(0.2, 0.5, 0.8, shade))
            axes.text(0.5 * (item["from"] + item["to"]), 0.02, f"{item['count']:.0f}", ha="center", fontsize=7)
            axes.plot(item["confidence"], item["right"], "k.")
        axes.plot([0.0, 1.0], [0.0, 1.0], "k:", linewidth=0.8)
        axes.set(xlim=(0.0, 1.0), ylim=(0.0, 1.0), title=name, xlabel="confidence", ylabel="share that is right")
        axes.title.set_fontsize(9)
    save_figure(figure, path)
