"""Chamber volumes from the finite element law."""

import json
import math

import numpy as np
import pytest

from mbpam_ros.actuator.gas_volume import LAW_FILE, gas_volume_tables
from mbpam_ros.configuration import ConfigError, config_path

TABLES = gas_volume_tables()
PRESSURE_PA = TABLES.pressure_start_pa + TABLES.pressure_step_pa * np.arange(len(TABLES.psc))
BEND_RAD = TABLES.bend_start_rad + TABLES.bend_step_rad * np.arange(TABLES.psc.shape[1])


@pytest.mark.parametrize(("pattern", "chambers"), [("psc", 1), ("pdc", 2)])
def test_the_samples_of_the_law_come_back(pattern, chambers):
    for row in json.loads(config_path(LAW_FILE).read_text(encoding="utf-8"))["tables"]:
        if row["pattern"] == pattern:
            table = getattr(TABLES, pattern)
            at_pressure = table[np.abs(PRESSURE_PA - 1e3 * row["p_kpa"]).argmin()]
            for bend_deg, volume_mm3 in zip(row["bend_deg"], row["gas_volume_mm3"], strict=True):
                volume = np.interp(math.radians(bend_deg), BEND_RAD, at_pressure)
                assert volume == pytest.approx(1e-9 * volume_mm3 / chambers, rel=1e-6)


@pytest.mark.parametrize("table", [TABLES.psc, TABLES.pdc])
def test_a_chamber_grows_with_its_pressure_and_never_vanishes(table):
    assert (np.diff(table, axis=0) >= 0.0).all()
    assert table.min() > 0.0


def test_a_file_that_is_no_law_is_named(monkeypatch, tmp_path):
    (tmp_path / "data").mkdir()
    (tmp_path / LAW_FILE).write_text("{}")
    (tmp_path / "gripper.yaml").touch()  # what makes a folder the configuration
    monkeypatch.setenv("MBPAM_CONFIG_DIR", str(tmp_path))
    gas_volume_tables.cache_clear()
    try:
        with pytest.raises(ConfigError, match="fe_bending_law.json"):
            gas_volume_tables()
    finally:
        gas_volume_tables.cache_clear()
