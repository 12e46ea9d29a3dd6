"""Mishaps change what they say they change, and nothing else."""

import numpy as np
import pandas as pd
import pytest
from physics.mishaps import (
    EDGE,
    LEAK,
    MISHAPS,
    MISTRACED,
    SHORT_LENGTH,
    happen,
)

PRESSURE = np.arange(20.0, 201.0, 20.0)
READ = ["curvature_per_m", "bend_angle_deg"]


@pytest.fixture
def readings():
    """Three specimens at each of four rates, straight lines through the origin."""
    rows = []
    for rate in (0.0, 10.0, 20.0, 30.0):
        for number in (1, 2, 3):
            slope = 0.1 * np.exp(-0.05 * rate) * (1.0 + 0.01 * number)
            name = f"A{rate:02.0f}-{number}"
            rows += [(name, rate, p, slope * p, 2.0 * slope * p) for p in PRESSURE]
    columns = ["specimen_id", "degradation_pct", "pressure_kPa", *READ]
    return pd.DataFrame(rows, columns=columns)


@pytest.mark.parametrize("name", MISHAPS)
@pytest.mark.parametrize("seed", range(3))
def test_only_the_rows_that_are_named_are_changed(readings, name, seed):
    before = readings.copy()
    wrong, mishap = happen(name, readings, np.random.default_rng(seed))
    pd.testing.assert_frame_equal(readings, before)
    assert mishap.name == name
    if name == "survivors_only":
        kept = before[~before["specimen_id"].isin(mishap.specimens)].reset_index(drop=True)
        pd.testing.assert_frame_equal(wrong, kept)
        return
    rows = list(mishap.rows)
    assert rows
    others = before.index.difference(rows)
    pd.testing.assert_frame_equal(wrong.loc[others], before.loc[others])
    assert set(before.loc[rows, "specimen_id"]) <= set(mishap.specimens)
    columns = ["pressure_kPa", *READ]
    changed = np.any(wrong.loc[rows, columns] != before.loc[rows, columns], axis=1)
    assert changed.all()


def test_the_same_seed_is_the_same_mishap(readings):
    first, second = (happen("leaking_specimen", readings, np.random.default_rng(3)) for _ in "ab")
    assert first[1] == second[1]
    pd.testing.assert_frame_equal(first[0], second[0])


def test_a_leak_reads_what_the_specimen_reads_at_the_pressure_inside(readings):
    wrong, mishap = happen("leaking_specimen", readings, np.random.default_rng(0))
    rows = list(mishap.rows)
    assert LEAK[0] <= mishap.size <= LEAK[1]
    assert wrong.loc[rows, READ].to_numpy() == pytest.approx(
        mishap.size * readings.loc[rows, READ].to_numpy()
    )


def test_sizes_are_those_that_are_stated(readings):
    wrong, mishap = happen("mistraced_pictures", readings, np.random.default_rng(1))
    off = wrong.loc[list(mishap.rows), READ] / readings.loc[list(mishap.rows), READ] - 1.0
    assert len(mishap.rows) == round(0.04 * len(readings))
    assert np.all((np.abs(off) >= MISTRACED[0] - 1e-9) & (np.abs(off) <= MISTRACED[1] + 1e-9))
    wrong, mishap = happen("short_lengths", readings, np.random.default_rng(1))
    rows = list(mishap.rows)
    ratio = wrong.loc[rows, "curvature_per_m"] / readings.loc[rows, "curvature_per_m"]
    assert ratio.to_numpy() == pytest.approx(1.0 / SHORT_LENGTH)
    assert (wrong["bend_angle_deg"] == readings["bend_angle_deg"]).all()
    wrong, mishap = happen("cut_off", readings, np.random.default_rng(1))
    top = readings["curvature_per_m"].max()
    assert EDGE[0] * top <= mishap.size <= EDGE[1] * top
    assert wrong["curvature_per_m"].max() <= 1.05 * mishap.size


def test_survivors_are_the_stiffest(readings):
    wrong, mishap = happen("survivors_only", readings, np.random.default_rng(1))
    left = wrong.loc[wrong["degradation_pct"] == 30.0, "specimen_id"].unique().tolist()
    assert left == ["A30-1"]
    assert set(mishap.specimens) == {"A30-2", "A30-3"}


def test_what_cannot_happen_is_refused(readings):
    with pytest.raises(ValueError, match="unknown mishap"):
        happen("fire", readings, np.random.default_rng(0))
    one = readings[readings["degradation_pct"] == 0.0]
    with pytest.raises(ValueError, match="differ enough"):
        happen("exchanged_labels", one, np.random.default_rng(0))
