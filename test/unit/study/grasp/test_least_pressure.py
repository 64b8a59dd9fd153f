import pytest

from mbpam_ros.study.grasp.least_pressure import LeastPressure, least_pressure

GRID = [40e3, 50e3, 60e3, 70e3]


@pytest.mark.parametrize("threshold_pa", [40.1e3, 44.4e3, 49.9e3, 50e3, 63.21e3, 70e3])
def test_the_least_pressure_is_found_to_the_resolution(threshold_pa):
    found = least_pressure(lambda pressure: pressure >= threshold_pa, GRID, 1e3)
    assert found.fails_pa < threshold_pa <= found.holds_pa
    assert found.holds_pa - found.fails_pa <= 1e3
    assert found.gaps_pa == ()


def test_pressures_above_it_that_fail_are_named():
    found = least_pressure(lambda pressure: 45e3 < pressure < 55e3 or pressure > 65e3, GRID, 1e3)
    assert found.fails_pa <= 45e3 < found.holds_pa
    assert found.gaps_pa == (60e3,)


def test_where_nothing_holds_there_is_none():
    assert least_pressure(lambda pressure: False, GRID, 1e3) == LeastPressure(None, None, ())


def test_where_everything_holds_it_is_the_first_of_the_grid_and_nothing_is_known_below():
    assert least_pressure(lambda pressure: True, GRID, 1e3) == LeastPressure(40e3, None, ())


def test_no_pressure_is_asked_twice():
    asked = []
    least_pressure(lambda pressure: bool(asked.append(pressure)) or pressure >= 57e3, GRID, 0.1e3)
    assert len(set(asked)) == len(asked)


@pytest.mark.parametrize(("grid", "resolution"), [([], 1e3), ([2e3, 1e3], 1e3), ([1e3, 1e3], 1e3), (GRID, 0.0)])
def test_a_search_that_cannot_end_is_refused(grid, resolution):
    with pytest.raises(ValueError, match="grid_pa|resolution_pa"):
        least_pressure(lambda pressure: True, grid, resolution)
