"""Many calls at once: each is answered."""

import threading
import time

import pytest
from rclpy.experimental import EventsExecutor
from std_srvs.srv import Trigger

from mbpam_ros.answer import Answer
from mbpam_ros.nodes.runtime import GripperNode, Health

CALLS = 100


class Busy(GripperNode):
    """A node with two services, one of which answers later."""

    def __init__(self, **node_options):
        super().__init__("busy", (), **node_options)
        self.later = []
        self.serve(Trigger, "at_once", lambda _: Answer(True, "done"))
        self.serve_later(Trigger, "later", lambda _, reply: self.later.append(reply))
        self.create_timer(0.01, self.answer)

    def health(self):
        return Health()

    def answer(self):
        replies, self.later = self.later, []
        for reply in replies:
            reply(Answer(False, "not done"))


@pytest.fixture
def server(graph):
    """The node in a thread of its own: a client that waits for its server's turn to end takes no answers meanwhile."""
    node = graph.add(Busy)
    graph.executor.remove_node(node)
    executor = EventsExecutor(context=node.context)
    executor.add_node(node)
    stopped = threading.Event()

    def spin():
        while not stopped.is_set():
            executor.spin_once(timeout_sec=0.05)

    thread = threading.Thread(target=spin)
    thread.start()
    yield
    stopped.set()
    thread.join()
    executor.shutdown()


@pytest.mark.usefixtures("server")
@pytest.mark.parametrize("names", [("at_once", "later"), ("later", "at_once")])
def test_a_burst_of_a_hundred_calls_on_each_of_two_services_is_answered_whole(graph, names):
    clients = [graph.test_node.create_client(Trigger, name) for name in names]
    graph.spin_until(lambda: all(client.service_is_ready() for client in clients), "the services")
    for client in clients:
        first = client.call_async(Trigger.Request())
        graph.spin_until(first.done, "a first round trip")
    futures = [client.call_async(Trigger.Request()) for _ in range(CALLS) for client in clients]
    began_s = time.monotonic()
    graph.spin_until(lambda: all(future.done() for future in futures), "every answer")
    print(f"{len(futures)} answers in {time.monotonic() - began_s:.2f} s")
    said = {name: "done" if name == "at_once" else "not done" for name in names}
    for index, future in enumerate(futures):
        assert future.result().message == said[names[index % 2]]
