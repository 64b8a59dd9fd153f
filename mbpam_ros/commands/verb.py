"""A verb of ``mbpam`` as data, so that the list of them is shown without loading what they do."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Verb:
    """One verb.

    Args:
        name: on the command line.
        summary: a line of help.
        module: of this package; with ``add_arguments`` and ``run``, or with ``VERBS`` of its own.
        resumes: whether the same command, with ``--json``, goes on from what an interrupted one has finished.
    """

    name: str
    summary: str
    module: str
    resumes: bool = False
