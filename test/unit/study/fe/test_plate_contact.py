import numpy as np
import pytest

from mbpam_ros.study.fe.plate_contact import ContactMemory, Plate, PlateContact

PLATE = Plate(distance_mm=-10.0, friction=0.6, stiffness_n_mm=50.0, slip_stiffness_n_mm=5.0)
NODES = np.array([4, 1, 2])
SHARES = np.array([0.5, 1.0, 1.0])
CONTACT = PlateContact(PLATE, NODES, SHARES)
INSIDE_MM = 0.02


def body(*places):
    """Six nodes of which the contact's three are at ``places``."""
    x = np.zeros((6, 3))
    x[NODES] = places
    return x


AT_REST = body((-10.0, 0.0, 1.0), (-10.0, 0.5, 2.0), (-9.0, 1.0, 3.0))


def settle(x, memory):
    """Revise until nothing changes, as the muscle does, at positions that do not answer."""
    for _ in range(6):
        memory = CONTACT.revised(x, memory)
    return memory


def pressed(slip_mm):
    return body((-10.0 - INSIDE_MM, 0.0, 1.0 + slip_mm), (-10.0 - INSIDE_MM, 0.5, 2.0 - slip_mm), (-9.0, 1.0, 3.0))


def test_a_node_outside_feels_nothing_and_one_inside_is_pushed_out_by_stiffness_times_depth():
    x = pressed(0.0)
    assert not CONTACT.pushes_n(AT_REST + (1.0, 0.0, 0.0), CONTACT.beside(AT_REST + (1.0, 0.0, 0.0))).any()
    pushes = CONTACT.pushes_n(x, settle(x, CONTACT.beside(AT_REST)))
    assert pushes == pytest.approx(np.array([[0.5, 0, 0], [1.0, 0, 0], [0, 0, 0]]))


def test_a_node_sticks_up_to_the_limit_of_friction_and_slides_against_it_beyond():
    touched = settle(pressed(0.0), CONTACT.beside(AT_REST))
    stuck = CONTACT.pushes_n(pressed(0.1), settle(pressed(0.1), touched))
    assert stuck[:, 2] == pytest.approx([-0.25, 0.5, 0.0])
    sliding = CONTACT.pushes_n(pressed(1.0), settle(pressed(1.0), touched))
    assert sliding[:, 2] == pytest.approx([-0.6 * 0.5, 0.6 * 1.0, 0.0])


def test_a_sliding_node_drags_its_anchor_and_sticks_when_it_comes_back():
    touched = settle(pressed(0.0), CONTACT.beside(AT_REST))
    settled = CONTACT.settled(pressed(1.0), settle(pressed(1.0), touched))
    assert CONTACT.pushes_n(pressed(1.0), settled)[0, 2] == pytest.approx(-0.3)
    back = settle(pressed(0.98), settled)
    assert not back.sliding.any()
    assert CONTACT.pushes_n(pressed(0.98), back)[0, 2] == pytest.approx(-0.3 + 2.5 * 0.02)
    far_back = settle(pressed(0.5), settled)
    assert CONTACT.pushes_n(pressed(0.5), far_back)[0, 2] == pytest.approx(0.3)


def test_a_pulled_node_is_let_go_and_starts_anew_where_it_lands():
    touched = settle(pressed(0.0), CONTACT.beside(AT_REST))
    lifted = pressed(0.0) + (1.0, 0.0, 0.0)
    free = CONTACT.settled(lifted, CONTACT.revised(lifted, touched))
    assert not free.touching.any()
    moved = CONTACT.settled(lifted + (0.0, 0.0, 4.0), free)
    landed = settle(pressed(4.0), moved)
    assert landed.touching.tolist() == [True, True, False]
    assert CONTACT.pushes_n(pressed(4.0), landed)[0, 2] == pytest.approx(0.0)


def test_the_tangent_is_the_slope_of_the_forces_whether_nodes_stick_or_slide():
    rng = np.random.default_rng(2)
    touching = np.ones(3, dtype=bool)
    sliding = np.array([True, False, True])
    direction = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    memory = ContactMemory(touching, sliding, direction, AT_REST[NODES])
    x = AT_REST + 0.1 * rng.standard_normal(AT_REST.shape)
    step = rng.standard_normal(x.shape)
    ahead, behind = (CONTACT.pushes_n(x + sign * 1e-6 * step, memory) for sign in (1.0, -1.0))
    slope = (CONTACT.tangent(x, memory) @ step.ravel()).reshape(-1, 3)
    assert slope[NODES] == pytest.approx(-(ahead - behind) / 2e-6, abs=1e-6)
    assert not np.delete(slope, NODES, axis=0).any()


def test_only_friction_makes_the_tangent_unsymmetric():
    memory = settle(pressed(1.0), settle(pressed(0.0), CONTACT.beside(AT_REST)))
    smooth = PlateContact(Plate(friction=0.0), NODES, SHARES)
    for contact in (CONTACT, smooth):
        tangent = contact.tangent(pressed(1.0), memory).toarray()
        assert (np.abs(tangent - tangent.T).max() < 1e-12) == contact.symmetric


@pytest.mark.parametrize(
    "wrong",
    [{"normal": (1.0, 1.0, 0.0)}, {"slip_direction": (1.0, 0.0, 0.0)}, {"friction": -0.1}, {"stiffness_n_mm": 0}],
)
def test_a_plate_that_cannot_be_is_refused(wrong):
    with pytest.raises(ValueError):
        Plate(**wrong)
