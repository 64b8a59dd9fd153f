"""Services whose answers may come later, and never faster than a client can take them.

The events executor awaits no coroutine, but it looks up ``send_response`` at every request: here that only notes where
the answer has to go.

A client with ROS's default quality of service keeps ten answers. One that asks a hundred times before it looks for the
first answer lost the other ninety; so no more than ten leave at once, none of the others while it still asks, and the
server keeps all requests meanwhile.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy

from mbpam_ros.answer import Answer
from mbpam_ros.nodes.messages import with_answer

REQUESTS_KEPT = 1000
CLIENT_KEEPS = 10
"""Depth of ROS's default quality of service for a client."""
CLIENT_LOOKS_WITHIN_S = 0.1
"""No more than :data:`CLIENT_KEEPS` answers of one service leave within this, counted from the last request."""
LONGEST_WAIT_S = 1.0
"""Nor do more within this while requests keep coming: where many ask at all times, one who asks does look."""

_QOS = QoSProfile(depth=REQUESTS_KEPT, reliability=ReliabilityPolicy.RELIABLE)


class Reply:
    """Where the answer to one request goes; call it once, at once or later."""

    def __init__(self, response: Any, send: Callable[[Any, Any], None]) -> None:
        self._response, self._send = response, send
        self._header: Any = None
        self._answered = False

    def __call__(self, answer: Answer) -> None:
        """Give the answer."""
        with_answer(self._response, answer)
        self._answered = True
        self._send_when_known()

    def address(self, header: Any) -> None:
        """Take from the executor whom the answer is for."""
        self._header = header
        self._send_when_known()

    def _send_when_known(self) -> None:
        if self._answered and self._header is not None:
            self._send(self._response, self._header)


class AnsweringService:
    """One service of a node.

    Args:
        node: whose service it is. It has to call :meth:`send_waiting` now and then, several times a second.
        service_type: ``Trigger`` or ``SetBool``.
        name: relative name.
        handle: takes the request, and where its answer goes.
    """

    def __init__(self, node: Node, service_type: type, name: str, handle: Callable[[Any, Reply], None]) -> None:
        self._handle = handle
        self._reply: Reply | None = None
        self._waiting: deque[tuple[Any, Any]] = deque()
        self._sent_s: deque[float] = deque([-float("inf")] * CLIENT_KEEPS, maxlen=CLIENT_KEEPS)
        self._asked_s = -float("inf")
        service = node.create_service(service_type, name, self._on_request, qos_profile=_QOS)
        self._send_now = service.send_response
        setattr(service, "send_response", self._address)  # noqa: B010  no method of its own to override

    def send_waiting(self) -> None:
        """Send the answers that are ready, as many as a client keeps."""
        while self._waiting and self._are_taken(time.monotonic()):
            self._sent_s.append(time.monotonic())
            self._send_now(*self._waiting.popleft())

    def _are_taken(self, now_s: float) -> bool:
        """Whether a client will have taken the answers it has room for."""
        since_sent_s, since_asked_s = now_s - self._sent_s[0], now_s - self._asked_s
        return since_sent_s >= LONGEST_WAIT_S or min(since_sent_s, since_asked_s) >= CLIENT_LOOKS_WITHIN_S

    def _on_request(self, request: Any, response: Any) -> Any:
        self._asked_s = time.monotonic()
        self._reply = Reply(response, self._send)
        self._handle(request, self._reply)
        return response

    def _address(self, _: Any, header: Any) -> None:
        """What the executor calls with the response right after the request was handled."""
        assert self._reply is not None
        reply, self._reply = self._reply, None
        reply.address(header)

    def _send(self, response: Any, header: Any) -> None:
        self._waiting.append((response, header))
        self.send_waiting()
