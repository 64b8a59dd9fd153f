"""The comparison with other simulators: what needs none of them, and short runs of those that are installed."""

import dataclasses
import io
import sys
from xml.etree import ElementTree

import numpy as np
import pytest

from mbpam_ros.commands.mbpam import main
from mbpam_ros.gripper import load_gripper
from mbpam_ros.study.peers import benchmark_peers
from mbpam_ros.study.peers.contact_accuracy import (
    CALL_S,
    mujoco_grasp_settings,
    own_grasp_settings,
    places_in_grasp,
    try_grasps,
)
from mbpam_ros.study.peers.grasp import LIFT_M, Grasp
from mbpam_ros.study.peers.mujoco_model import MujocoFreeBend, MujocoGrasp, link_spans, model_xml, strained_lengths
from mbpam_ros.study.peers.own import OwnFreeBend, OwnGrasp
from mbpam_ros.study.peers.problem import TipErrors, finger_problem, static_tips, tip_errors
from mbpam_ros.study.peers.pyelastica_model import PyelasticaFreeBend, rod_elements
from mbpam_ros.study.peers.search import AccuracyError, Tried, cheapest, compare, cpu_ms_per_s, cpu_ms_per_s_of_starts
from mbpam_ros.terminal import Progress

PROBLEM = finger_problem(load_gripper(), 100e3, 0.02)
STRAINED = finger_problem(load_gripper(), 100e3, 0.02, all_strains=True)
LEVEL = dataclasses.replace(STRAINED, gravity_m_s2=(9.81, 0.0, 0.0))
LENGTH = PROBLEM.geometry.length_m


@pytest.mark.parametrize("module", ["mujoco", "elastica"])
def test_without_a_peer_the_command_says_what_to_install(module, monkeypatch, capsys):
    if module == "elastica":
        monkeypatch.setitem(sys.modules, "mujoco", object())
    monkeypatch.setitem(sys.modules, module, None)
    assert main(["peers"]) == 1
    assert "pip install 'mbpam_ros[bench]'" in capsys.readouterr().err


def test_chain_has_the_muscle_in_mass_compliance_and_free_bend():
    joints = ElementTree.fromstring(model_xml(PROBLEM, 8, 0.002, "implicitfast")).findall(".//joint")
    bending = [joint for joint in joints if joint.get("axis") == "0 1 0"]
    assert len(joints) == 4 * 8 * 2
    compliance = sum(1.0 / float(joint.get("stiffness")) for joint in bending) / 4
    assert compliance == pytest.approx(PROBLEM.geometry.active_length_m / PROBLEM.stiffness_n_m2)
    free = sum(float(joint.get("springref")) for joint in bending) / 4
    assert free == pytest.approx(PROBLEM.moment_n_m * PROBLEM.geometry.active_length_m / PROBLEM.stiffness_n_m2)
    spans = link_spans(PROBLEM, 8)
    assert spans[0, 0] == 0.0 and spans[-1, 1] == PROBLEM.geometry.length_m
    np.testing.assert_array_equal(spans[1:, 0], spans[:-1, 1])


def test_chain_with_all_strains_has_the_muscle_in_compliance_free_stretch_and_coupling():
    of, active = STRAINED.strains, STRAINED.geometry.active_length_m
    root = ElementTree.fromstring(model_xml(STRAINED, 8, 0.002, "implicitfast"))
    twists = [joint for joint in root.findall(".//joint") if joint.get("axis") == "0 0 1" and joint.get("stiffness")]
    assert sum(1.0 / float(joint.get("stiffness")) for joint in twists) / 4 == pytest.approx(
        active / of.torsion_stiffness_n_m2
    )
    tendons = root.findall("./tendon/fixed")
    assert len(tendons) == len(twists) == 4 * 8
    assert sum(1.0 / float(each.get("stiffness")) for each in tendons) / 4 == pytest.approx(
        active / of.axial_stiffness_n
    )
    assert sum(float(each.get("springlength")) for each in tendons) / 4 == pytest.approx(of.free_stretch * active)
    coupled = {}
    for term in root.findall("./tendon/fixed/joint"):
        coupled[term.get("joint")] = coupled.get(term.get("joint"), 0.0) + float(term.get("coef"))
    bends = [share for name, share in coupled.items() if name.startswith("bend")]
    np.testing.assert_allclose(bends, np.full(32, -of.slope_m))
    assert strained_lengths(STRAINED, 8).sum() == pytest.approx(active)


@pytest.mark.parametrize("shares", [6, 10, 13, 20, 40])
def test_elements_of_cosserat_rods_end_less_than_one_before_the_muscle_does(shares):
    elements, start, length = rod_elements(PROBLEM, shares)
    assert elements > shares and start + 0.5 * length == pytest.approx(PROBLEM.geometry.end_length_m)
    left = PROBLEM.geometry.length_m - start - elements * length
    assert -1e-12 <= left < length


def test_tips_at_rest_are_those_of_the_boundary_value_problem():
    own = OwnFreeBend(PROBLEM, modes=4, step_s=0.005)
    own.advance(3.0)
    np.testing.assert_allclose(own.tips_m(), static_tips(PROBLEM), atol=1e-5)


@pytest.mark.parametrize("problem", [STRAINED, LEVEL])
def test_tips_at_rest_with_all_strains_are_those_of_the_boundary_value_problem(problem):
    own = OwnFreeBend(problem, 4, 0.005, twist_modes=3, stretch_modes=3)
    own.advance(3.0)
    np.testing.assert_allclose(own.tips_m(), static_tips(problem), atol=2e-5)
    # That both leave the strains out would show here.
    bend_alone = static_tips(dataclasses.replace(problem, strains=None))
    assert np.linalg.norm(static_tips(problem) - bend_alone, axis=1).min() > 0.02 * LENGTH


def test_both_boundary_value_solutions_agree_where_muscles_only_bend():
    nearly_hanging = dataclasses.replace(PROBLEM, gravity_m_s2=(1e-9, 0.0, 9.81))
    np.testing.assert_allclose(static_tips(nearly_hanging), static_tips(PROBLEM), atol=1e-6)


def test_errors_are_relative_to_the_length_and_infinite_where_not_finite():
    reference = np.zeros((4, 4, 3))
    found = reference.copy()
    found[0, 1, 0], found[-1, 2, 1] = 0.03, 0.01
    errors = tip_errors(found, reference, 1.0)
    assert errors.static_pct == pytest.approx(1.0)
    assert errors.transient_pct == pytest.approx(3.0 / np.sqrt(3.0))
    found[0, 0, 0] = np.nan
    assert not tip_errors(found, reference, 1.0).within(1e9, 1e9)


def test_cheapest_is_among_the_accurate_or_refused():
    tried = [Tried({}, TipErrors(static, 0.5), cost, None) for static, cost in ((2.0, 1.0), (0.5, 3.0), (0.1, 2.0))]
    assert cheapest(tried, 1.0, 1.0).cpu_ms_per_s == 2.0
    with pytest.raises(AccuracyError, match="0.01 %"):
        cheapest(tried, 0.01, 1.0)


def test_ratio_is_the_median_of_peer_over_ours():
    ours, peer = iter([9.0, 1.0, 2.0, 1.0]), iter([9.0, 4.0, 6.0, 9.0])
    assert compare(lambda: next(ours), lambda: next(peer), 3)["ratio"] == 4.0


def test_an_interrupted_comparison_goes_on_with_the_parts_that_are_missing(monkeypatch, tmp_path):
    measured = []

    def part(name, ends=False):
        def measure():
            if ends:
                raise KeyboardInterrupt
            measured.append(name)
            return {"ratio": 2.0}

        return measure

    def compared(ends):
        parts = {"first": part("first"), "second": part("second", ends)}
        monkeypatch.setattr(benchmark_peers, "_bending", lambda *_: parts)
        return benchmark_peers.compare_with_peers(
            load_gripper(), 0.02, 1, tmp_path / "runs.json", Progress(io.StringIO()), [benchmark_peers.BEND]
        )

    monkeypatch.setattr(benchmark_peers, "_software", lambda: {"versions": {}})
    with pytest.raises(KeyboardInterrupt):
        compared(ends=True)
    result = compared(ends=False)
    assert measured == ["first", "second"]
    assert result["first"] == result["second"] == 2.0


def test_costs_are_of_the_window_from_each_start(monkeypatch):
    class Counted:
        starts, clock = 0, 0.0

        def reset(self):
            self.starts += 1
            self.clock += 7.0  # not timed

        def advance(self, seconds):
            self.clock += 2.0 * seconds

    counted = Counted()
    monkeypatch.setattr("time.process_time", lambda: counted.clock)
    assert cpu_ms_per_s(counted, counted.advance, 0.5, starts=3) == pytest.approx(2000.0)
    assert counted.starts == 3
    assert cpu_ms_per_s_of_starts(counted, counted.advance, 0.3) == pytest.approx(2000.0)
    assert counted.starts == 13


def test_mujoco_comes_to_rest_where_the_rod_does():
    pytest.importorskip("mujoco")
    peer = MujocoFreeBend(PROBLEM, 10, 0.002, "implicitfast")
    peer.advance(2.0)
    assert np.abs(peer.tips_m() - static_tips(PROBLEM)).max() < 0.005 * PROBLEM.geometry.length_m


@pytest.mark.parametrize("problem", [STRAINED, LEVEL])
def test_mujoco_with_all_strains_tends_to_the_rod_at_rest_with_the_square_of_an_element(problem):
    pytest.importorskip("mujoco")
    errors = []
    for elements in (5, 10):
        peer = MujocoFreeBend(problem, elements, 0.002, "implicitfast")
        peer.advance(2.0)
        errors.append(np.abs(peer.tips_m() - static_tips(problem)).max())
    assert errors[1] < 0.005 * LENGTH
    assert 3.0 < errors[0] / errors[1] < 5.0


def test_pyelastica_comes_to_rest_where_the_rod_does():
    pytest.importorskip("elastica")
    peer = PyelasticaFreeBend(PROBLEM, 10, 0.0003)
    peer.advance(2.0)
    assert np.abs(peer.tips_m() - static_tips(PROBLEM)).max() < 0.005 * PROBLEM.geometry.length_m


GRASP = Grasp(finger_problem(load_gripper(), 70e3, 0.02), radius_m=0.030, mass_kg=0.046, depth_m=0.085, friction=0.6)


def test_a_grasp_is_judged_by_the_tips_and_the_sphere_against_the_simulators_own_converged_run():
    reference_m = places_in_grasp(OwnGrasp(GRASP, 3, 0.0005))
    assert reference_m.shape == (50, 5, 3)
    assert GRASP.depth_m - reference_m[-1, 4, 2] == pytest.approx(LIFT_M, abs=0.005)  # it is held
    settings = [{"modes": 3, "step_s": step} for step in (0.001, 0.01)] + [{"modes": 1, "step_s": 0.002}]
    fine, coarse, stiff = try_grasps(
        lambda **setting: OwnGrasp(GRASP, **setting), settings, reference_m, GRASP.problem.geometry.active_length_m
    )
    assert fine.errors.within(1.0, 1.0)
    assert fine.errors.transient_pct < coarse.errors.transient_pct < stiff.errors.transient_pct
    assert all(each.cpu_ms_per_s > 0.0 for each in (fine, coarse, stiff))


def test_every_setting_of_a_grasp_that_is_tried_goes_into_a_call_a_whole_number_of_times():
    pytest.importorskip("mujoco")
    for setting in own_grasp_settings() + mujoco_grasp_settings():
        assert CALL_S / setting["step_s"] == pytest.approx(round(CALL_S / setting["step_s"]))


def test_both_simulators_grasp_the_same_sphere_with_the_same_fingers():
    pytest.importorskip("mujoco")
    ours, peer = OwnGrasp(GRASP, 3, 0.0005), MujocoGrasp(GRASP, 8, 0.0005, "implicitfast", "pyramidal", 1e-6)
    start_m = ours.places_m()
    np.testing.assert_allclose(peer.places_m(), start_m, atol=1e-6)
    for each in (ours, peer):
        each.advance(0.02)  # before they touch it
    moved = np.linalg.norm(ours.places_m() - start_m, axis=1)
    assert moved[:4].min() > 0.02 * LENGTH
    assert np.linalg.norm(peer.places_m() - ours.places_m(), axis=1).max() < 0.01 * LENGTH
