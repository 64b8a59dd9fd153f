"""Many calls at once: each is answered."""

import itertools
from types import SimpleNamespace

import pytest
from std_srvs.srv import Trigger

from mbpam_ros.answer import Answer
from mbpam_ros.nodes import answering
from mbpam_ros.nodes.runtime import GripperNode, Health

CALLS = 100


class Busy(GripperNode):
    """A node with two services, one of which answers later."""

    def __init__(self, **node_options):
        super().__init__("busy", (), **node_options)
        self.asked = 0
        self.later = []
        self.serve_later(Trigger, "at_once", self.answer_at_once)
        self.serve_later(Trigger, "later", self.answer_later)
        self.create_timer(0.01, self.answer)

    def health(self):
        return Health()

    def answer_at_once(self, _, reply):
        self.asked += 1
        reply(Answer(True, "done"))

    def answer_later(self, _, reply):
        self.asked += 1
        self.later.append(reply)

    def answer(self):
        replies, self.later = self.later, []
        for reply in replies:
            reply(Answer(False, "not done"))


@pytest.fixture
def clock(monkeypatch):
    """The server's time, in the test's hands: how fast a computer is decides nothing."""
    now = SimpleNamespace(s=1000.0)
    monkeypatch.setattr(answering, "time", SimpleNamespace(monotonic=lambda: now.s))
    return now


@pytest.mark.parametrize("names", [("at_once", "later"), ("later", "at_once")])
def test_a_client_that_asks_a_hundred_times_and_looks_in_time_misses_no_answer(graph, clock, names):
    server = graph.add(Busy)
    clients = [graph.test_node.create_client(Trigger, name) for name in names]
    graph.spin_until(lambda: all(client.service_is_ready() for client in clients), "the services")
    for client in clients:
        first = client.call_async(Trigger.Request())
        graph.spin_until(first.done, "a first round trip")
    clock.s += answering.LONGEST_WAIT_S
    server.asked = 0

    futures = [client.call_async(Trigger.Request()) for _ in range(CALLS) for client in clients]
    graph.spin_until(lambda: server.asked == len(futures) and not server.later, "every request")
    for looks in itertools.count(1):
        taken = min(looks * answering.CLIENT_KEEPS * len(clients), len(futures))
        graph.spin_until(lambda: sum(future.done() for future in futures) == taken, f"{taken} answers")  # noqa: B023
        if taken == len(futures):
            break
        clock.s += answering.CLIENT_LOOKS_WITHIN_S
    said = {name: "done" if name == "at_once" else "not done" for name in names}
    for index, future in enumerate(futures):
        assert future.result().message == said[names[index % 2]]
