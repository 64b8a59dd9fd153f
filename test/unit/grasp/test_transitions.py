"""What each request does in each state of a grasp, as the manual shows it."""

import pytest

from mbpam_ros.grasp.transitions import REQUESTS, together, transitions

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def rows():
    return {(row.state, row.request): row for row in transitions()}


@pytest.fixture(scope="module")
def pairs():
    return {tuple(row.request.split(", then ")): row for row in together()}


STATES = (
    "idle",
    "closing, camera's",
    "closing, operator's",
    "holding, camera's",
    "holding, operator's",
    "releasing",
    "fault, vents",
    "fault, keeps the object",
)


def test_every_request_is_asked_in_every_state(rows):
    assert list(dict.fromkeys(state for state, _ in rows)) == list(STATES)
    assert len(rows) == len(STATES) * len(REQUESTS)
    assert all(row.answer for row in rows.values())


@pytest.mark.parametrize("state", STATES)
def test_a_stop_is_done_in_every_state(rows, state):
    row = rows[state, "grasp/stop"]
    assert (row.accepted, row.then) == (True, "fault, vents")


@pytest.mark.parametrize("phase", ["closing", "holding"])
def test_the_operator_overrules_the_camera_and_not_the_other_way(rows, phase):
    over = rows[f"{phase}, camera's", "grasp/<mode>"]
    assert (over.accepted, over.then) == (True, "closing, operator's")
    for whose in ("camera's", "operator's"):
        refused = rows[f"{phase}, {whose}", "grasp/auto"]
        assert (refused.accepted, refused.then) == (False, f"{phase}, {whose}")
        assert "not preempted by the camera" in refused.answer


def test_what_is_refused_changes_nothing(rows):
    assert all(row.then == row.state for row in rows.values() if not row.accepted)


def test_a_stop_wins_whichever_comes_first(pairs):
    for request in REQUESTS:
        if request != "grasp/reset":
            assert pairs["grasp/stop", request].then == "fault, vents"
        assert pairs[request, "grasp/stop"].then == "fault, vents"


def test_the_operator_wins_over_the_camera_whichever_comes_first(pairs):
    for order in (("grasp/auto", "grasp/<mode>"), ("grasp/<mode>", "grasp/auto")):
        assert pairs[order].then == "closing, operator's"
