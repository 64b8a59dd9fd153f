"""Pauses of valve commands in a soak: those that a node's end or freeze explains are told apart from all others."""

from types import SimpleNamespace

import pytest

from mbpam_ros.commands import soak


class Clock:
    """A clock that stands until it is moved; a look at it takes 10 ms."""

    now_s = 0.0

    def monotonic(self):
        self.now_s += 0.01
        return self.now_s


@pytest.fixture
def clock(monkeypatch):
    clock = Clock()
    monkeypatch.setattr(soak, "time", clock)
    return clock


@pytest.fixture
def use(clock):
    """Return the random use of a valve controller that is not there."""
    operator = SimpleNamespace(
        node=SimpleNamespace(create_subscription=lambda *_: None), enable=lambda _: None, spin=lambda: None, grasp={}
    )
    node = SimpleNamespace(kill=lambda: None, wait=lambda: None)
    processes = SimpleNamespace(processes={"valve_controller": node}, start=lambda _: None)
    return soak.NodeSoak(processes, operator, seed=0)


def commands(use, clock, count, every_s):
    for _ in range(count):
        clock.now_s += every_s - 0.01
        use._on_command(None)


def test_a_pause_while_all_nodes_run_counts(use, clock):
    commands(use, clock, 5, 0.01)
    commands(use, clock, 1, 0.05)
    told = use.result
    assert (told.commands, told.late_commands, told.longest_gap_ms) == (6, 1, 50.0)
    assert told.befallen_gap_ms == {}


def test_what_a_killed_node_holds_up_is_told_by_its_name_even_if_its_last_command_comes_late(use, clock):
    commands(use, clock, 5, 0.01)
    use._befall("valve_controller", soak.KILLED)
    commands(use, clock, 1, 0.01)
    commands(use, clock, 1, 5.0)
    use._enable()
    commands(use, clock, 5, 0.01)
    told = use.result
    assert (told.commands, told.late_commands) == (10, 0) and told.longest_gap_ms == 10.0
    assert told.befallen_gap_ms["valve_controller killed"] == pytest.approx(5000.0)
    assert "longest pause after valve_controller killed 5.00 s" in soak.nodes_text(told)
