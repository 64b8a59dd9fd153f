"""Where every picture begins and ends. matplotlib is needed only when one is drawn."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from mbpam_ros.errors import MbpamError

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class PictureError(MbpamError, RuntimeError):
    """The picture cannot be drawn or written; the message says why."""


def require_matplotlib() -> None:
    """Check that pictures can be drawn, before minutes are spent on what they are to show.

    Raises:
        PictureError: matplotlib is not installed.
    """
    try:
        import matplotlib.figure  # noqa: F401
    except ImportError as error:
        raise PictureError("pictures need matplotlib: pip install 'mbpam_ros[report]'") from error


def new_figure(width_in: float, height_in: float) -> Figure:
    """Return an empty figure [inch] whose parts make room for each other.

    Raises:
        PictureError: matplotlib is not installed.
    """
    require_matplotlib()
    from matplotlib.figure import Figure

    return Figure(figsize=(width_in, height_in), layout="constrained")


def save_figure(figure: Figure, path: Path, dpi: int = 110) -> None:
    """Write a figure; folders are made, the suffix is the format.

    Raises:
        PictureError: the file cannot be written, or there is no such format.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, dpi=dpi)
    except (OSError, ValueError) as error:  # matplotlib raises ValueError for an unknown suffix
        raise PictureError(f"cannot write {path}: {error}") from error
