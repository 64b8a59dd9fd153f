"""What the package's parts below the nodes log, said by a node."""

from __future__ import annotations

import logging
from typing import Protocol


class NodeLogger(Protocol):
    """What is used of a node's logger."""

    def info(self, message: str) -> object:
        """Say something of interest."""


class _Forwarder(logging.Handler):
    def __init__(self, logger: NodeLogger) -> None:
        super().__init__(logging.INFO)
        self._logger = logger

    def emit(self, record: logging.LogRecord) -> None:
        self._logger.info(record.getMessage())


def forward_logs(name: str, logger: NodeLogger) -> None:
    """Have what is logged under ``name`` be said by a node's logger, in place of one that was given before."""
    source = logging.getLogger(name)
    source.handlers = [handler for handler in source.handlers if not isinstance(handler, _Forwarder)]
    source.addHandler(_Forwarder(logger))
    source.setLevel(logging.INFO)
